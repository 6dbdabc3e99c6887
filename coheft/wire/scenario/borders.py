"""When something that may come at any time takes effect: at the border of a block, or at a sample."""

from __future__ import annotations

import math

_ROUNDING = 1e-9
"""A border so long before a time is not before it [s]: borders and times are multiples of rounded numbers."""


def first_border(time: float, duration: float) -> int:
    """Number of the first border that is not before a time [s], where border ``k`` is at ``k * duration`` [s]."""
    return math.ceil((time - _ROUNDING) / duration)
