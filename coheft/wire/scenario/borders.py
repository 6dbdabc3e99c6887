"""Times at which events take effect: at the start of a block, or at a sample."""

import math

_ROUNDING = 1e-9
"""Tolerance for the rounding of times [s]."""


def first_border(time: float, duration: float) -> int:
    """Return the index of the first border at or after a time [s], where border ``k`` is at ``k * duration`` [s]."""
    return math.ceil((time - _ROUNDING) / duration)
