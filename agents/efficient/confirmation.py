"""Confirmation by new rows of the load that was known before: it may have changed while rows were missing, or while the
team was another one.

Poses are uncertain then. Those that had to explain the wrenches of another load would be wrong, and hide that it is
another one. So wrenches that fit the load badly are left out of fits until poses are better known, and if the load
turns out to have changed, none of them counts as a wrench of the former load.
"""

from __future__ import annotations


class Confirmation:
    """Counts rows that fit the load.

    Args:
        needed: Number of rows that have to fit.

    Attributes:
        since: Number of the first row that may be of another load.
        distrusts_wrenches: Whether wrenches fit the load so badly that only uncertain poses can explain it.
    """

    def __init__(self, needed: int) -> None:
        self._needed, self._missing = needed, 0
        self.since = -1
        self.distrusts_wrenches = False

    @property
    def is_open(self) -> bool:
        """Whether rows are still missing."""
        return self._missing > 0

    def begin(self, since: int) -> None:
        """From this row on, the load may be another one."""
        self._missing, self.since = self._needed, since

    def end(self) -> None:
        """There is nothing to confirm."""
        self._missing, self.distrusts_wrenches = 0, False

    def count(self) -> None:
        """The newest row fits the load."""
        self._missing, self.distrusts_wrenches = max(0, self._missing - 1), False
