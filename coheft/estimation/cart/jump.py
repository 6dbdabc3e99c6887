"""Has the cart suddenly become another one? A test on the newest innovations of its filter."""

from __future__ import annotations

from collections.abc import Sequence

from coheft.estimation.chi_square import chi_square_threshold

WINDOWS = (1, 4, 16)
"""Lengths over which innovations are summed, in samples: a jolt shows at once, a change of mass while accelerating."""
FALSE_ALARMS = 1e-9
"""Probability per sample and window that an unchanged cart is taken for another one."""


def changed_since(surprises: Sequence[float], freedom: int) -> int:
    """Number of newest samples that cannot be of the same cart, 0 if all can.

    Args:
        surprises: See ``Update.surprise``, the newest first.
        freedom: Degrees of freedom of each.
    """
    for window in WINDOWS:
        threshold = chi_square_threshold(freedom * window, FALSE_ALARMS)
        if len(surprises) >= window and sum(surprises[:window]) > threshold:
            return window
    return 0
