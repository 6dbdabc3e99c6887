"""Sensors that contradict the motion of the team: one innovation test per robot and window of rows, and what follows.

    s_i = sum of whitened residuals r_i of k rows / sqrt(k),    s_i^T (I + k (D + U_i))^-1 s_i ~ chi-square(12)

``r_i`` is the reading of robot i less its prediction from the fused motion of all robots, in standard deviations. In
units of the noise, ``D`` is the variance by which sensors have drifted since their offsets were found, and ``U_i`` that
of predictions, by errors of poses and of found sensor errors. It is large while few rows show these, and negligible
later, so it is computed only if there would be a contradiction without it. A sensor that is frozen, saturated, biased
or late, a wrong clock, a robot that has let go, and one that lies all show here. Each robot decides alone: there is no
vote.

no contradiction -> one row only                   leave it out
                 -> a window of rows               take back the rows since its first; leave out all until it is over
it lasts too long, or returns again and again      start over: the poses may be wrong
no contradiction for a while                       it is over; new rows have to confirm what was known
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum, auto

import numpy as np

from coheft.agents.efficient.settings import Guards, RowCounts
from coheft.estimation.chi_square import chi_square_threshold
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.rows import KINEMATICS_SIZE

_WINDOWS = np.array([1, 2, 4, 8, 16])
"""Numbers of newest rows that are tested."""
_LONGEST = int(_WINDOWS[-1])

Uncertainty = Callable[[int, int], Array]
"""Covariance (12, 12) of a robot's residuals, mean over so many newest rows, because of the estimate's errors."""


class Use(Enum):
    """What to do with a row."""

    KEEP = auto()
    RESUME = auto()  # a contradiction is over: keep the row
    LEAVE_OUT = auto()
    BACK_TO_FIRST = auto()  # a contradiction has begun: leave out the row, take back those since the first
    START_OVER = auto()


class Contradictions:
    """The contradictions of one team.

    Args:
        count: Number of robots.
        guards: Thresholds.
        drift: The diagonal of ``D``, shape (N, 12) or (1, 12).
        rows: After how many rows without a contradiction one is over (``confirming``), after how many it is another one
            if it returns (``calm``), and after how many it has lasted too long (``lasting``).

    Attributes:
        robot: Index of a robot whose sensors contradict the others at present, or None.
    """

    def __init__(self, count: int, guards: Guards, drift: Array, rows: RowCounts) -> None:
        self._count, self._largest = count, chi_square_threshold(KINEMATICS_SIZE, guards.contradiction)
        self._drifts, self._spread = bool(drift.any()), 1.0 + _WINDOWS[:, None, None] * drift
        self._summed = 0  # number of rows in the sums
        self._sums = np.zeros((_LONGEST + 1, KINEMATICS_SIZE * count))  # after each of the newest rows, the newest last
        self._confirming, self._lasting, self._calm = rows.confirming, rows.lasting, rows.calm
        self.robot: int | None = None
        self._revision = 0
        self._last: int | None = None  # the last such robot, of more than one row in succession
        self._began, self._ended, self._newest = -1, -1, -rows.confirming  # numbers of rows

    def add(self, number: int, residuals: Array, revision: int, uncertainty: Uncertainty) -> tuple[Use, int]:
        """Test a row.

        Args:
            number: Number of the row.
            residuals: Of all robots, in standard deviations, shape (12 N,).
            revision: Of the estimate; residuals at different ones are not summed.
            uncertainty: Computes ``U_i`` of a robot, mean over so many newest rows, shape (12, 12).

        Returns:
            What to do with the row, and after ``BACK_TO_FIRST`` the number of the first row that contradicts.
        """
        if revision != self._revision:
            self._forget()
        self._revision = revision
        found, is_calm = self._worst(residuals, uncertainty), number > self._newest + self._confirming
        if found is None:
            if self.robot is None:
                return Use.KEEP, number
            if number < self._newest + self._confirming:
                return Use.LEAVE_OUT, number
            self.robot = None
            return Use.RESUME, number
        (robot, rows), is_new = found, self.robot is None
        self._newest = number
        self._forget()
        if is_new and is_calm and rows == 1:  # one wrong sample, or a jump that a late sensor shows a row later
            return Use.LEAVE_OUT, number
        is_again = robot == self._last and number <= self._ended + self._calm
        if is_new and not is_again:
            self._began = number
        self.robot, self._last, self._ended = robot, robot, number
        if number - self._began > self._lasting:
            return Use.START_OVER, number
        return Use.BACK_TO_FIRST if is_new else Use.LEAVE_OUT, number - rows + 1

    def _forget(self) -> None:
        """Discard earlier residuals, because the estimate has changed or they have shown what they contain."""
        self._summed = 0
        self._sums[:] = 0.0

    def _worst(self, residuals: Array, uncertainty: Uncertainty) -> tuple[int, int] | None:
        """Add residuals of a row. Return the robot of the worst contradiction, and the number of newest rows over which
        it shows; None if there is none.
        """
        sums, largest = self._sums, self._largest
        sums[:-1] = sums[1:]
        sums[-1] += residuals
        self._summed += 1
        windows = _WINDOWS[: np.searchsorted(_WINDOWS, self._summed, side="right")]
        summed = (sums[-1] - sums[-1 - windows]).reshape(len(windows), self._count, KINEMATICS_SIZE)
        squares = np.square(summed)
        if self._drifts:
            squares /= self._spread[: len(windows)]
        squares = squares.sum(axis=2) / windows[:, None]
        while squares.max() > largest:
            window, robot = divmod(int(squares.argmax()), self._count)
            rows, total = int(windows[window]), summed[window, robot]
            spread = self._spread[window, robot % self._spread.shape[1]]
            if total @ np.linalg.solve(np.diag(spread) + rows * uncertainty(robot, rows), total) / rows > largest:
                return robot, rows
            squares[window, robot] = 0.0
        return None
