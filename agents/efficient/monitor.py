"""Sensors that contradict the motion of the team: one innovation test per robot and window of rows.

    s_i = sum of whitened residuals r_i of k rows / sqrt(k),    s_i^T (I + k D)^-1 s_i ~ chi-square(12)

``r_i`` is the reading of robot i less its prediction from the fused motion of all robots, in standard deviations. Pose
errors contribute far less, as long as poses are known. ``D`` is the variance by which sensors have drifted since their
offsets were found, in units of the noise. A sensor that is frozen, saturated, biased or late, a wrong clock, a robot
that has let go, and one that lies all show here. Each robot decides alone: there is no vote.
"""

from __future__ import annotations

import numpy as np

from coheft.agents.efficient.settings import Guards
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.rows import KINEMATICS_SIZE

_WINDOWS = np.array([1, 2, 4, 8, 16])
"""Numbers of newest rows that are tested."""
_LONGEST = int(_WINDOWS[-1])


class Monitor:
    """Tests sums of the newest residuals.

    Args:
        count: Number of robots.
        guards: Thresholds.
        drift: The diagonal of ``D``, shape (N, 12) or (1, 12).
    """

    def __init__(self, count: int, guards: Guards, drift: Array) -> None:
        self._count, self._guards = count, guards
        self._spread = 1.0 + _WINDOWS[:, None, None] * drift if drift.any() else None
        self._sums = np.zeros((_LONGEST + 1, KINEMATICS_SIZE * count))
        """Running sum after each of the newest rows, the newest last."""
        self._rows = 0

    def forget(self) -> None:
        """Discard earlier residuals, for instance because the estimate has changed."""
        self._rows = 0
        self._sums[:] = 0.0

    def add(self, residuals: Array) -> tuple[int, int] | None:
        """Add residuals of a row in standard deviations, shape (12 N,).

        Returns:
            Of the worst contradiction, the index of the robot and the number of newest rows over which it shows; None
            if there is none.
        """
        sums = self._sums
        sums[:-1] = sums[1:]
        sums[-1] += residuals
        self._rows += 1
        windows = _WINDOWS[: np.searchsorted(_WINDOWS, self._rows, side="right")]
        summed = (sums[-1] - sums[-1 - windows]).reshape(len(windows), self._count, KINEMATICS_SIZE)
        squares = np.square(summed)
        if self._spread is not None:
            squares /= self._spread[: len(windows)]
        squares = squares.sum(axis=2) / windows[:, None]
        index = int(squares.argmax())
        window, robot = divmod(index, self._count)
        is_contradiction = squares.flat[index] > self._guards.largest_contradiction
        return (robot, int(windows[window])) if is_contradiction else None
