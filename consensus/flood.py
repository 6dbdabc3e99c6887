"""Numbers that every robot has of its own and all want to know: handed on from neighbour to neighbour."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from itertools import islice

import numpy as np
import numpy.typing as npt

from coheft.estimation.spatial import Array
from coheft.wire.message_size import PER_MESSAGE


class Flood:
    """One agent's copy of a table with a row per robot; the row with the highest stamp wins.

    A row reaches everybody in as many blocks as the graph's diameter. Agents always tell each other a checksum of their
    stamps, and rows only while a neighbour's is another one: nothing is sent in vain, and what is lost is sent again.
    Of a table with more than ``PER_MESSAGE`` rows a message holds the new ones, the first heard first, and others in
    turn; what does not fit follows with the next.

    Args:
        robots: Number of robots.
        width: Numbers per row.
    """

    def __init__(self, robots: int, width: int) -> None:
        self._table = np.full((robots, 1 + width), -1.0)
        self._heard: dict[str, float] = {}
        self._news: dict[int, None] = {}
        self._turn = 0
        self._digest: float | None = None
        self._newest = -1

    def tell(self, robot: int, stamp: int, row: Array) -> None:
        """Put in a row: the own one, or one that this robot has worked out for another."""
        self._table[robot, 0], self._table[robot, 1:] = stamp, row
        self._news[robot] = None
        self._note_stamps()

    def hear(self, neighbour: str, digest: float | None, rows: Array | None) -> None:
        """Take in what a neighbour told: its ``digest``, and rows of its table if it sent some."""
        if digest is not None:
            self._heard[neighbour] = digest
        if rows is None or digest == self.digest or not self.fits(rows) or np.any(rows[:, :2] % 1.0):
            return
        robots = rows[:, 0].astype(np.int64)
        if not self._are_robots(robots):
            return
        newer = rows[:, 1] > self._table[robots, 0]
        if newer.any():
            self._table[robots[newer]] = rows[newer, 1:]
            self._news |= dict.fromkeys(robots[newer].tolist())
            self._note_stamps()

    def _note_stamps(self) -> None:
        """They have changed."""
        self._digest, self._newest = None, int(self._table[:, 0].max())

    def _are_robots(self, robots: npt.NDArray[np.int64]) -> bool:
        """Whether these can be the numbers of the rows in a message: of a small table all, in order."""
        count = len(self._table)
        if count <= PER_MESSAGE:
            return np.array_equal(robots, np.arange(count))
        return bool(robots.min() >= 0 and robots.max() < count)

    def fits(self, rows: Array) -> bool:
        """Whether rows that a neighbour sent have the right shape."""
        most = min(len(self._table), PER_MESSAGE)
        return rows.ndim == 2 and 0 < len(rows) <= most and rows.shape[1] == 1 + self._table.shape[1]

    def rows(self, stamp: int) -> Array | None:
        """Everybody's row (N, width) if all bear this stamp, else None."""
        return self._table[:, 1:].copy() if np.all(self._table[:, 0] == stamp) else None

    def row(self, robot: int) -> tuple[int, Array]:
        """The newest row of one robot, and its stamp, -1 if there is none."""
        return int(self._table[robot, 0]), self._table[robot, 1:].copy()

    @property
    def newest(self) -> int:
        """The largest stamp of all rows, -1 if there are none."""
        return self._newest

    @property
    def table(self) -> Array:
        """All rows, shape (N, 1 + width): stamps first."""
        return self._table.copy()

    @property
    def digest(self) -> float:
        """Checksum of the stamps: a sum would be the same for two tables each with a row that the other lacks."""
        if self._digest is None:
            self._digest = float(zlib.crc32(self._table[:, 0].tobytes()))
        return self._digest

    def told(self) -> Array | None:
        """What to send to the neighbours: rows (k, 2 + width) that begin with the robot's number and the stamp.

        None if they all know everything.
        """
        digest = self.digest
        if all(heard == digest for heard in self._heard.values()):
            self._news.clear()
            return None
        robots = self._next_rows()
        return np.column_stack([robots, self._table[robots]])

    def _next_rows(self) -> list[int]:
        count = len(self._table)
        if count <= PER_MESSAGE:
            return list(range(count))
        chosen = list(islice(self._news, PER_MESSAGE))
        for robot in chosen:
            del self._news[robot]
        while len(chosen) < PER_MESSAGE:
            chosen.append(self._turn)
            self._turn = (self._turn + 1) % count
        return chosen


class Floods:
    """Several tables that travel together, by name."""

    def __init__(self, tables: Mapping[str, Flood]) -> None:
        self._tables = dict(tables)

    def hear(self, neighbour: str, channels: Mapping[str, Array]) -> None:
        """Take in a neighbour's ``channels``."""
        digests = channels.get("digests")
        if digests is None or digests.shape != (len(self._tables),):
            return
        for digest, (name, flood) in zip(digests, self._tables.items(), strict=True):
            flood.hear(neighbour, float(digest), channels.get(name))

    def fit(self, channels: Mapping[str, Array]) -> bool:
        """Whether what a neighbour sent of these tables, if anything, has the right shapes."""
        digests = channels.get("digests")
        return (digests is None or digests.shape == (len(self._tables),)) and all(
            name not in channels or flood.fits(channels[name]) for name, flood in self._tables.items()
        )

    def channels(self) -> dict[str, Array]:
        """What to send to the neighbours."""
        told = {"digests": np.array([flood.digest for flood in self._tables.values()])}
        for name, flood in self._tables.items():
            rows = flood.told()
            if rows is not None:
                told[name] = rows
        return told
