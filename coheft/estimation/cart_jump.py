"""Has the cart suddenly become another one? A test on the newest innovations of its filter."""

from __future__ import annotations

from collections.abc import Sequence

from coheft.estimation.cart_filter import MOTION_SIZE
from coheft.estimation.chi_square import chi_square_threshold

WINDOWS = (1, 4, 16)
"""Lengths over which innovations are summed, in samples: a jolt shows at once, a change of mass while accelerating."""
FALSE_ALARMS = 1e-9
"""Probability per sample and window that an unchanged cart is taken for another one."""

_FREEDOM = MOTION_SIZE + 1
"""Of one surprise, for a cart with one axle."""
_THRESHOLDS = tuple(chi_square_threshold(_FREEDOM * window, FALSE_ALARMS) for window in WINDOWS)


def changed_since(surprises: Sequence[float]) -> int:
    """Number of newest samples that cannot be of the same cart, 0 if all can.

    Args:
        surprises: See ``Update.surprise``, the newest first.
    """
    for window, threshold in zip(WINDOWS, _THRESHOLDS, strict=True):
        if len(surprises) >= window and sum(surprises[:window]) > threshold:
            return window
    return 0
