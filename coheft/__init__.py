"""coheft: robots that hold one load together find out, by themselves, what they are holding."""

__version__ = "0.1.0"
