"""What a team holds, from a recording: all samples of all robots in one place (Zhang et al., 2025, and beyond).

Functions raise ``RecordingError`` if something that they need was not recorded, or cannot be that of robots which hold
one load. Its message says what was found, where, and what was expected.
"""
