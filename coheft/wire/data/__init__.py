"""Recordings of sensors as files, and the checks on them."""
