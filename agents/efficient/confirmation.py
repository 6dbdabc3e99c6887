"""Confirmation by new rows of the load that was known before: it may have changed while rows were missing, or while the
team was another one.

Poses are uncertain then. Those that had to explain the wrenches of another load would be wrong, and hide that it is
another one. So if the load turns out to have changed, none of these wrenches counts as one of the former load.
"""

from __future__ import annotations

from coheft.agents.efficient.settings import RowCounts


class Confirmation:
    """Counts rows that fit the load.

    Args:
        rows: How many rows have to fit (``confirming``).

    Attributes:
        since: Number of the first row that may be of another load.
    """

    def __init__(self, rows: RowCounts) -> None:
        self._rows, self._missing = rows, 0
        self.since = -1

    @property
    def is_open(self) -> bool:
        """Whether rows are still missing."""
        return self._missing > 0

    def begin(self, since: int) -> None:
        """From this row on, the load may be another one; rows that were not confirmed before still are not."""
        self.since = min(self.since, since) if self.is_open else since
        self._missing = self._rows.confirming

    def end(self) -> None:
        """There is nothing to confirm."""
        self._missing = 0

    def count(self) -> None:
        """The newest row fits the load."""
        self._missing = max(0, self._missing - 1)
