"""What becomes of rows while a robot's motion sensors contradict the team.

no contradiction -> one row only                   leave it out
                 -> a window of rows               take back the rows since its first; leave out all until it is over
it lasts too long, or returns again and again      start over: the poses may be wrong
no contradiction for a while                       it is over; new rows have to confirm what was known
"""

from __future__ import annotations

from enum import Enum, auto

from coheft.agents.efficient.monitor import Monitor
from coheft.agents.efficient.settings import Guards, RowCounts
from coheft.estimation.geometry.spatial import Array


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
        drift: See ``Monitor``.
        rows: After how many rows without a contradiction one is over (``confirming``), after how many it is another one
            if it returns (``calm``), and after how many it has lasted too long (``lasting``).

    Attributes:
        robot: Index of a robot whose sensors contradict the others at present, or None.
    """

    def __init__(self, count: int, guards: Guards, drift: Array, rows: RowCounts) -> None:
        self._monitor = Monitor(count, guards, drift)
        self._confirming, self._lasting, self._calm = rows.confirming, rows.lasting, rows.calm
        self.robot: int | None = None
        self._revision = 0
        self._last: int | None = None  # the last such robot, of more than one row in succession
        self._began, self._ended, self._newest = -1, -1, -rows.confirming  # numbers of rows

    def add(self, number: int, residuals: Array, revision: int) -> tuple[Use, int]:
        """Test a row.

        Args:
            number: Number of the row.
            residuals: See ``Monitor.add``.
            revision: Of the estimate; residuals at different ones are not summed.

        Returns:
            What to do with the row, and after ``BACK_TO_FIRST`` the number of the first row that contradicts.
        """
        if revision != self._revision:
            self._monitor.forget()
        self._revision = revision
        found, is_calm = self._monitor.add(residuals), number > self._newest + self._confirming
        if found is None:
            if self.robot is None:
                return Use.KEEP, number
            if number < self._newest + self._confirming:
                return Use.LEAVE_OUT, number
            self.robot = None
            return Use.RESUME, number
        (robot, rows), is_new = found, self.robot is None
        self._newest = number
        self._monitor.forget()
        if is_new and is_calm and rows == 1:  # one wrong sample, or a jump that a late sensor shows a row later
            return Use.LEAVE_OUT, number
        is_again = robot == self._last and number <= self._ended + self._calm
        if is_new and not is_again:
            self._began = number
        self.robot, self._last, self._ended = robot, robot, number
        if number - self._began > self._lasting:
            return Use.START_OVER, number
        return Use.BACK_TO_FIRST if is_new else Use.LEAVE_OUT, number - rows + 1
