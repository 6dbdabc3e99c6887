"""Recordings of sensors as files, and the checks on them.

Functions raise ``RecordingError`` for what cannot be used; its message names the place, and says what was expected.
Those that read or write files raise ``OSError`` if the system refuses.
"""
