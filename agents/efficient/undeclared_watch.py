"""When to test for sensor errors whose tolerance is zero, and how long one that was found counts."""

from __future__ import annotations

from coheft.agents.efficient.knowledge import Knowledge
from coheft.estimation.moments.undeclared import UndeclaredError


class UndeclaredWatch:
    """Tests for undeclared errors at growing intervals.

    Two tests in a row have to find the same error. It is over once as many rows in succession are free of it as it was
    found with; the first time, after ``lasts`` rows at most.

    Args:
        growth: The next test is due when the number of rows has grown by this factor.
        lasts: Number of rows after which an error that was found for the first time may be over.

    Attributes:
        found: The error, None if there is none.
    """

    def __init__(self, growth: float, lasts: int) -> None:
        self.found: UndeclaredError | None = None
        self._growth, self._lasts = growth, lasts
        self._found_with = self._over_with = 0  # rows with which it was found, and with which it is over
        self.begin(0)

    def begin(self, first: int) -> None:
        """Start again with other rows; the first test is due at so many."""
        self._next = first
        self._last_found: tuple[int, str] | None = None

    def test(self, known: Knowledge) -> bool:
        """Test if it is due; return whether an error has been found, after which estimation has to start over."""
        rows = known.buffer.load_rows
        if rows < self._next or known.misses_poses:
            return False
        self._next = round(self._growth * rows)
        found, last = known.undeclared_error(), self._last_found
        self._last_found = None if found is None else (found.robot, found.kind)
        if found is None:
            if rows >= self._over_with:
                self.found = None
                if rows > 2 * self._found_with:
                    self._found_with = 0
            return False
        if self._last_found != last:  # a sensor may have been faulty for a while only
            self._next = 0
            return False
        is_again = self._found_with > 0
        self.found, self._found_with = found, max(rows, self._found_with)
        self._over_with = self._found_with if is_again else min(rows, self._lasts)
        return True
