"""When to test for sensor errors whose tolerance is zero, and how long one that was found counts."""

from __future__ import annotations

from coheft.agents.efficient.knowledge import Knowledge
from coheft.estimation.moments.undeclared import UndeclaredError


class UndeclaredWatch:
    """Tests for undeclared errors at growing intervals.

    Two tests in a row have to find the same error; one that is less certain, or that few rows show, is suspected. An
    error is over once as many rows in succession are free of it as it was found with, or ``lasts`` rows.

    Args:
        doubt: Size from which on an error is suspected.
        growth: The next test is due when the number of rows has grown by this factor, in large teams by its square.
        lasts: Number of rows after which an error is over that does not show any more.

    Attributes:
        found: The error, None if there is none.
        suspected: The most significant one in the last test, None if it may be chance.
        since: Number of the row since which one is suspected.
    """

    def __init__(self, doubt: float, growth: float, lasts: int) -> None:
        self.found: UndeclaredError | None = None
        self.suspected: UndeclaredError | None = None
        self.since = 0
        self._doubt, self._growth, self._lasts = doubt, growth, lasts
        self._over_with = 0  # rows of the load when the error is over
        self.begin(0)

    def begin(self, least: int) -> None:
        """Start again with other rows; to find an error takes so many."""
        self._least, self._next, self._tested_with = least, 0, 0
        self._last_found: tuple[int | None, str] | None = None

    def dismiss(self, since: int) -> None:
        """An error that is only suspected since this row or later was no error."""
        if self.since >= since:
            self.suspected = self._last_found = None

    def test(self, known: Knowledge) -> bool:
        """Test if it is due; return whether an error has been found, after which estimation has to start over."""
        rows = known.buffer.load_rows
        if known.misses_poses or self._tested_with <= rows < self._next:
            return False
        largest, last, self._tested_with = known.undeclared_error(), self._last_found, rows
        if self.suspected is None:
            self.since = int(known.buffer.numbers[known.buffer.count - 1])
        self.suspected = largest if largest is not None and largest.size > self._doubt else None
        growth = self._growth if known.is_small else self._growth**2
        self._next = round(growth * rows) if self.suspected is None else 0
        found = self.suspected
        if found is None or found.size <= 1.0 or rows < self._least:
            self._last_found = None
            if known.age >= self._over_with:
                self.found = None
            return False
        self._last_found = found.robot, found.kind
        if self._last_found != last:  # a sensor may have been faulty for a while only
            return False
        self.found, self._over_with = found, min(known.age, self._lasts)
        return True
