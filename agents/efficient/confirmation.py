"""Confirmation by new rows of the load that was known before: it may have changed while rows were missing, or while the
team was another one.

Poses are uncertain then. Those that had to explain the wrenches of another load would be wrong, and hide that it is
another one. So wrenches that fit the load badly are left out of fits until poses are better known, and if the load
turns out to have changed, none of them counts as a wrench of the former load. If that takes too long, the load is
estimated anew.
"""

from __future__ import annotations

from coheft.agents.efficient.settings import RowCounts


class Confirmation:
    """Counts rows that fit the load.

    Args:
        rows: How many rows have to fit (``confirming``), and for how many wrenches may be distrusted (``lasting``).

    Attributes:
        since: Number of the first row that may be of another load.
    """

    def __init__(self, rows: RowCounts) -> None:
        self._rows, self._missing = rows, 0
        self._distrusted_at: int | None = None
        self.since = -1

    @property
    def is_open(self) -> bool:
        """Whether rows are still missing."""
        return self._missing > 0

    @property
    def distrusts_wrenches(self) -> bool:
        """Whether wrenches fit the load so badly that only uncertain poses can explain it."""
        return self._distrusted_at is not None

    def begin(self, since: int) -> None:
        """From this row on, the load may be another one; rows that were not confirmed before still are not."""
        self.since = min(self.since, since) if self.is_open else since
        self._missing = self._rows.confirming

    def end(self) -> None:
        """There is nothing to confirm."""
        self._missing, self._distrusted_at = 0, None

    def count(self) -> None:
        """The newest row fits the load."""
        self._missing, self._distrusted_at = max(0, self._missing - 1), None

    def fits_badly(self, number: int) -> bool:
        """At this row wrenches fit the load badly; return whether they have done so for too long."""
        if self._distrusted_at is None:
            self._distrusted_at = number
        return number - self._distrusted_at > self._rows.lasting
