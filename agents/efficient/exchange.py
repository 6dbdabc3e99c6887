"""Flooding of rows: a robot forwards each row that it receives for the first time to its neighbours.

    after d hops a row is d blocks old; each row is sent twice, so that a single lost message does no harm

Rows may arrive in any order. A row that never arrives delays no other. Memory is bounded whatever neighbours send: a
table of the newest blocks with one entry per row and robot.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from coheft.agents.efficient.row_times import RowTimes
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.flexing import FLEXING_SIZE
from coheft.estimation.moments.rows import ROW_SIZE

WINDOW = 64
"""Number of newest blocks whose rows are accepted, or twice the number of hops if that is more."""
_LABELS, _ROWS = "labels", "rows"
_ONE = np.ones(1)
_SHAPES = tuple((ROW_SIZE * copies + more,) for copies in (1, 2) for more in (0, FLEXING_SIZE))
_TEAMS = 2**32
"""Team numbers are below this."""


@dataclass(frozen=True, eq=False)
class RowMessage:
    """Message of a robot to its neighbours after a block.

    Attributes:
        team: Number of the sender's team, see ``Gossip.membership``.
        changed_at: Number of the first row with the present load, as far as the sender knows; -1 if it never changed.
        labels: Index of the robot and number of each row, shape (k, 2).
        rows: Shape (k, 24), or more with rates, in single precision: rounding errors are far below the noise, and occur
            once, at the robot that measured.
    """

    team: int
    changed_at: int
    labels: npt.NDArray[np.int32]
    rows: npt.NDArray[np.float32]

    def channels(self) -> dict[str, npt.NDArray[np.generic]]:
        """Return arrays by name; the first label is ``(team, changed_at)``."""
        head = np.array([[self.team, self.changed_at]]).astype(np.int32)
        return {_LABELS: np.concatenate([head, self.labels]), _ROWS: self.rows}

    @staticmethod
    def of_channels(channels: Mapping[str, npt.NDArray[Any]]) -> RowMessage | None:
        """Inverse of ``channels``; None if the arrays are not such a message."""
        labels, rows = channels.get(_LABELS), channels.get(_ROWS)
        if labels is None or rows is None or labels.dtype != np.int32 or rows.dtype != np.float32:
            return None
        if rows.shape[1:] not in _SHAPES or labels.shape != (len(rows) + 1, 2):
            return None
        team, changed_at = labels[0].tolist()
        return RowMessage(team % _TEAMS, changed_at, labels[1:], rows)


class Exchange:
    """One robot's table of rows in transit.

    Args:
        team: Number of the team.
        count: Number of robots.
        own: Index of this robot.
        hops: Diameter of the graph.
        times: Times of rows.
        size: Length of one robot's row, with rates if there are any.

    Attributes:
        changed_at: Number of a new load's first row, the newest that any robot has reported; -1 if none.
        window: Number of newest blocks whose rows are accepted.
        disputed: Robots of which two different rows with one number arrived, and the block in which that last happened.
    """

    def __init__(self, team: int, count: int, own: int, hops: int, times: RowTimes, size: int = ROW_SIZE) -> None:
        self.team, self.changed_at = team, -1
        self.disputed: dict[int, int] = {}
        self._count, self._own, self._times = count, own, times
        self.window = max(WINDOW, 2 * hops)
        places = times.complete(self.window) + 1
        self._rows = np.zeros((places, count, size))
        self._numbers = np.full((places, count), -1)  # of each row in the table
        self._news: list[tuple[npt.NDArray[np.int32], npt.NDArray[np.float32]]] = []
        self._told_once: list[tuple[npt.NDArray[np.int32], npt.NDArray[np.float32]]] = []

    def enter(self, number: int, row: Array) -> None:
        """Add this robot's own row, shape (size,)."""
        place = number % len(self._numbers)
        if self._numbers[place, self._own] < number:
            rounded = row.astype(np.float32)
            self._numbers[place, self._own], self._rows[place, self._own] = number, rounded
            self._news.append((np.array([[self._own, number]], dtype=np.int32), rounded[None]))

    def hear(self, message: RowMessage, block: int) -> None:
        """Process a neighbour's message that arrived before this block."""
        if message.team != self.team or message.rows.shape[1] != self._rows.shape[2]:
            return
        if self.changed_at < message.changed_at < self._times.begun_from(block):
            self.changed_at = message.changed_at
        labels, rows = message.labels.astype(np.int64), message.rows
        ages = block - self._times.last_block(labels[:, 1])
        is_known = (labels[:, 0] >= 0) & (labels[:, 0] < self._count) & (labels[:, 1] >= 0)
        heard = np.flatnonzero(is_known & (ages > 0) & (ages < self.window))
        robots, numbers = labels[heard].T
        places = numbers % len(self._numbers)
        is_new = self._numbers[places, robots] < numbers
        news = heard[is_new]
        if len(news):
            self._numbers[places[is_new], robots[is_new]] = numbers[is_new]
            self._rows[places[is_new], robots[is_new]] = rows[news]
            self._news.append((message.labels[news], rows[news]))
        is_there = self._numbers[places, robots] == numbers
        differs = is_there & (self._rows[places, robots] != rows[heard]).any(axis=1)
        self.disputed |= dict.fromkeys(robots[differs].tolist(), block)

    def tell(self, changed_at: int) -> RowMessage:
        """Return the message for all neighbours; ``changed_at`` is the first row of the present load."""
        told = self._told_once + self._news
        self._told_once, self._news = self._news, []
        labels = [labels for labels, _ in told] or [np.zeros((0, 2), dtype=np.int32)]
        rows = [rows for _, rows in told] or [np.zeros((0, self._rows.shape[2]), dtype=np.float32)]
        return RowMessage(self.team, changed_at, np.concatenate(labels), np.concatenate(rows))

    def complete(self, number: int) -> Array | None:
        """The team's row of this number: the rows of all robots, the constant 1, and what follows rows.

        Returns:
            Shape (size N + 1,); None while a robot's is missing.
        """
        place = number % len(self._numbers)
        if (self._numbers[place] != number).any():
            return None
        rows = self._rows[place]
        return np.concatenate([rows[:, :ROW_SIZE].ravel(), _ONE, rows[:, ROW_SIZE:].ravel()])

    def missing(self, number: int) -> list[int]:
        """Indices of the robots whose row of this number has not arrived."""
        missing: list[int] = np.flatnonzero(self._numbers[number % len(self._numbers)] != number).tolist()
        return missing
