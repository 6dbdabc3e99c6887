"""Has the cart suddenly become another one? A test on the newest innovations of its filter."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coheft.estimation.chi_square import chi_square_threshold

WINDOWS = (1, 4, 16, 64)
"""Lengths over which innovations are summed, in samples: a jolt shows at once, a change of mass while accelerating."""
FALSE_ALARMS = 1e-9
"""Probability per sample and window that an unchanged cart is taken for another one."""
USUAL_OF = 128
"""What is usual is seen in so many samples before a window."""
_LEAST = 32
"""And not in fewer."""


class JumpTest:
    """Compares the newest innovations with what a right model would give, or with what is usual if that is more.

    Args:
        freedom: Degrees of freedom of each surprise.
    """

    def __init__(self, freedom: int) -> None:
        self._freedom = freedom
        self._median = chi_square_threshold(freedom, 0.5)
        self._usual = dict.fromkeys(WINDOWS, 0.0)

    def changed_since(self, surprises: Sequence[float]) -> int:
        """Number of newest samples that cannot be of the same cart, 0 if all can.

        Args:
            surprises: See ``Update.surprise``, of steps from which something can be learned, the newest first.
        """
        for window in WINDOWS:
            before = surprises[window : window + USUAL_OF]
            if len(before) >= _LEAST:
                self._usual[window] = max(1.0, float(np.median(before)) / self._median)
            usual = self._usual[window]
            if usual == 0.0 or len(surprises) < window:
                continue
            if sum(surprises[:window]) > usual * chi_square_threshold(self._freedom * window, FALSE_ALARMS):
                return window
        return 0
