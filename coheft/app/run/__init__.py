"""Starts and follows the processes of a run, and ends all of them with it."""
