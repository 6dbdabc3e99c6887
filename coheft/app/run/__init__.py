"""Starts the processes of a run, follows them, and never leaves one behind."""
