"""Limits of messages that the library of consensus needs as well, so that it loads nothing else from here."""

PER_MESSAGE = 32
"""Largest number of robots' records in a message."""
