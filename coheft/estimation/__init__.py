"""Estimation: pure functions and filters on arrays. No sockets, no clock, no threads."""
