"""When to look for a load change: at once if wrenches are a surprise, together show another mass, or another robot has
noticed a change; else in turn.
"""

from collections import deque

from coheft.agents.efficient.innovations import EvaluatedRow
from coheft.agents.efficient.settings import Guards, RowCounts
from coheft.estimation.chi_square import chi_square_threshold
from coheft.estimation.moments.rows import WRENCH_SIZE

_SURPRISES = 2
"""So many surprising rows in succession start a look."""
_LOOKS = 4
"""While the newest rows together show another mass, so many looks are started in the time over which they do."""


class ChangeTestSchedule:
    """Says after each row whether to look for a load change.

    Args:
        rows: How often each robot looks without a reason (``turn``), and over how many rows another mass has to show.
        guards: Thresholds.
        slot: Number of the row of a turn after which this robot looks.
    """

    def __init__(self, rows: RowCounts, guards: Guards, slot: int) -> None:
        self._rows, self._slot, self._masses = rows, slot, deque[float](maxlen=rows.shortest)
        self._largest_surprise = chi_square_threshold(WRENCH_SIZE, guards.surprise)
        self._least_sum = chi_square_threshold(1, guards.mass_surprise) * rows.shortest
        self._news = -1  # first row of the newest change that another robot has reported
        self.begin()

    def begin(self) -> None:
        """Start again with other rows."""
        self._paused_until = -1
        self.found()

    def found(self) -> None:
        """Forget all reasons to look: what they pointed to has been found."""
        self._surprises, self._closely_until = 0, -1
        self._masses.clear()
        self._rests = 0  # so many rows have to come before the mass starts another look

    def is_paused(self, number: int) -> bool:
        """Whether a look is of no use yet at this row."""
        return number < self._paused_until

    def pause(self, until: int) -> None:
        """Looks before this row are of no use; -1: they are of use from now on."""
        self._paused_until = until

    def look_closely_after(self, first: int, news_at: int, number: int) -> None:
        """Look after every row for a while, if a change that another robot has noticed is news. ``first`` is its first
        row, ``news_at`` that of the newest change that this robot has noticed, and ``number`` the newest row.
        """
        if first > max(news_at + self._rows.turn, self._news):
            self._news, self._closely_until = first, number + self._rows.turn

    def is_due(self, number: int, row: EvaluatedRow) -> bool:
        """Whether to look after a row."""
        self._surprises = self._surprises + 1 if row.wrench @ row.wrench > self._largest_surprise else 0
        shows_another_mass = self._shows_another_mass(row.mass)
        is_urgent = self._surprises >= _SURPRISES or number <= self._closely_until or shows_another_mass
        return is_urgent or number % self._rows.turn == self._slot

    def _shows_another_mass(self, residual: float) -> bool:
        """Whether the newest rows together show another mass, and have not started a look shortly before."""
        masses = self._masses
        masses.append(residual)
        self._rests = max(0, self._rests - 1)
        shows = self._rests == 0 and len(masses) == masses.maxlen and sum(masses) ** 2 > self._least_sum
        if shows:
            self._rests = max(1, self._rows.shortest // _LOOKS)
        return shows
