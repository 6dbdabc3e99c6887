"""A test for sudden changes of the cart, on the newest innovations of its filter."""

from collections.abc import Sequence

import numpy as np

from coheft.estimation.chi_square import chi_square_threshold

WINDOWS = (1, 4, 16, 64)
"""Window lengths [samples]: a jolt shows at once, a change of the mass only while accelerating."""
FALSE_ALARMS = 1e-9
"""Probability of a false alarm per sample and window."""
USUAL_OF = 128
"""Number of samples before a window that show the usual size of innovations,"""
_LEAST = 32
"""and the least number."""


class JumpTest:
    """Compares the newest innovations with those of a right model, or with the usual ones if these are larger.

    Each squared innovation has ``freedom`` degrees of freedom.
    """

    def __init__(self, freedom: int) -> None:
        self._freedom = freedom
        self._median = chi_square_threshold(freedom, 0.5)
        self._usual = dict.fromkeys(WINDOWS, 0.0)

    def changed_since(self, surprises: Sequence[float]) -> int:
        """Number of newest samples that contradict an unchanged cart; 0 if there is no alarm.

        Surprises are squared innovations (``Update.surprise``), the newest first; 0 for steps that are ignored.
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
