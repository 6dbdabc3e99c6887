"""Whether residuals are larger than noise, because some samples are wrong: somebody's sensor was off for a while."""

from __future__ import annotations

import math

_SLACK, _ROUGH_SLACK = 0.03, 0.6
"""Share by which the mean square of residuals may be larger than usual: always, and where poses are rough."""
_SIGMAS = 6.0
"""Standard deviations by which it may be larger by chance."""
_RESIDUALS = 6.0
"""Of the nine residuals in a sample so many, in a small team, are not of the motion, which all find together."""


class NoiseJudge:
    """Compares the samples of one fit with those of the fits before."""

    def __init__(self) -> None:
        # Mean squares of residuals: the usual one, and that of the samples that were left out last, 0 if none were.
        self._usual, self._left_out = 1.0, 0.0

    def must_leave_out(self, square: float, count: float, *, are_rough: bool) -> bool:
        """Whether some of the samples must be wrong, which are not to be used then.

        If others, in their place, have residuals as large, noise is larger than the sensors claim, and that is what is
        usual from now on.

        Args:
            square: Mean square of the residuals of the worst robot, in units of what noise leaves in them.
            count: Number of samples.
            are_rough: Whether the poses that they were seen with are.
        """
        by_chance = _SIGMAS * math.sqrt(2.0 / (_RESIDUALS * max(count, 1.0)))
        limit = 1.0 + (_ROUGH_SLACK if are_rough else _SLACK) + by_chance
        if square > limit * max(self._usual, self._left_out):
            self._left_out = square
            return True
        self._usual = max(1.0, square if self._left_out else min(square, self._usual))
        self._left_out = 0.0
        return False
