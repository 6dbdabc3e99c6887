"""When to look for a load change: at once if wrenches are a surprise or another robot has noticed one, else in turn."""

from coheft.agents.efficient.settings import RowCounts
from coheft.estimation.geometry.spatial import Array

_SURPRISES = 2
"""So many surprising rows in succession start a look."""


class Looks:
    """Says after each row whether to look for a load change.

    Args:
        rows: How often each robot looks without a reason (``turn``).
        turn: Number of the row of a turn after which this robot looks.
        largest_surprise: Chi-square from which on the wrench of a row is a surprise.
    """

    def __init__(self, rows: RowCounts, turn: int, largest_surprise: float) -> None:
        self._rows, self._turn, self._largest_surprise = rows, turn, largest_surprise
        self._news = -1  # first row of the newest change that another robot has told of
        self.begin()

    def begin(self) -> None:
        """Start again with other rows."""
        self._paused_until = -1
        self.found()

    def found(self) -> None:
        """What was to be looked for has been found."""
        self._surprises, self._closely_until = 0, -1

    def are_paused(self, number: int) -> bool:
        """Whether a look is of no use yet at this row."""
        return number < self._paused_until

    def pause(self, until: int) -> None:
        """Looks before this row are of no use."""
        self._paused_until = until

    def look_closely_after(self, first: int, news_at: int, number: int) -> None:
        """Look after every row for a while, if what another robot has noticed at row ``first`` is news.

        Args:
            first: First row of the change.
            news_at: First row of the newest change that this robot has noticed.
            number: Number of the newest row.
        """
        if first > max(news_at + self._rows.turn, self._news):
            self._news, self._closely_until = first, number + self._rows.turn

    def are_due(self, number: int, wrench: Array) -> bool:
        """Whether to look after a row with this residual of the wrench, (6,) in standard deviations."""
        self._surprises = self._surprises + 1 if wrench @ wrench > self._largest_surprise else 0
        is_urgent = self._surprises >= _SURPRISES or number <= self._closely_until
        return is_urgent or number % self._rows.turn == self._turn
