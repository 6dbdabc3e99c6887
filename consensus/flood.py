"""Numbers that every robot has of its own and all want to know: handed on from neighbour to neighbour."""

from __future__ import annotations

import numpy as np

from coheft.estimation.spatial import Array


class Flood:
    """One agent's copy of a table with a row per robot; the row with the highest stamp wins.

    A row reaches everybody in as many blocks as the graph's diameter.

    Args:
        robots: Number of robots.
        width: Numbers per row.
    """

    def __init__(self, robots: int, width: int) -> None:
        self._table = np.full((robots, 1 + width), -1.0)

    def tell(self, robot: int, stamp: int, row: Array) -> None:
        """Put in the own row."""
        self._table[robot, 0], self._table[robot, 1:] = stamp, row

    def hear(self, table: Array) -> None:
        """Take in a neighbour's table."""
        if table.shape == self._table.shape:
            newer = table[:, 0] > self._table[:, 0]
            self._table[newer] = table[newer]

    def rows(self, stamp: int) -> Array | None:
        """Everybody's row (N, width) if all bear this stamp, else None."""
        return self._table[:, 1:].copy() if np.all(self._table[:, 0] == stamp) else None

    @property
    def table(self) -> Array:
        """What to send to the neighbours, shape (N, 1 + width): stamps first."""
        return self._table.copy()
