"""Tables with a row for each robot, which all robots learn by flooding."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from itertools import islice

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.wire.messages.size import PER_MESSAGE


class Flood:
    """One agent's copy of a table with a row per robot; the row with the highest stamp wins.

    A row reaches all in as many blocks as the graph's diameter. Agents always tell each other a checksum of their
    stamps, and rows from when a neighbour's is known to be another one until it is known to be the same: twice, as a
    rule, and again whenever a message was lost.
    Of a table with more than ``PER_MESSAGE`` rows a message holds the new ones, the first heard first, and others in
    turn; what does not fit follows with the next.

    Args:
        robots: Number of robots.
        width: Numbers per row.
    """

    def __init__(self, robots: int, width: int) -> None:
        # As rows are sent: the robot's number, the stamp, and what it tells.
        self._rows = np.full((robots, 2 + width), -1.0)
        self._rows[:, 0] = np.arange(robots)
        self._heard: dict[str, float] = {}
        self._news: dict[int, None] = {}
        self._turn = 0
        self._digest: float | None = None
        self._newest = -1

    def tell(self, robot: int, stamp: int, row: Array) -> None:
        """Enter a row: the robot's own, or one that it has computed for another."""
        self._rows[robot, 1], self._rows[robot, 2:] = stamp, row
        self._news[robot] = None
        self._note_stamps()

    def hear(self, neighbour: str, digest: float | None, rows: Array | None) -> None:
        """Process a neighbour's message: its ``digest``, and rows of its table if it sent any."""
        if digest is not None:
            self._heard[neighbour] = digest
        if rows is None or digest == self.digest or not self.fits(rows) or not self._are_of_robots(rows):
            return
        robots = rows[:, 0].astype(np.int64)
        newer = rows[:, 1] > self._rows[robots, 1]
        if newer.any():
            self._rows[robots[newer]] = rows[newer]
            self._news |= dict.fromkeys(robots[newer].tolist())
            self._note_stamps()

    def _note_stamps(self) -> None:
        """They have changed."""
        self._digest, self._newest = None, int(self._rows[:, 1].max())

    def _are_of_robots(self, rows: Array) -> bool:
        """Whether rows can be in a message: their stamps whole numbers, and of a small table all, in order."""
        if (rows[:, 1] % 1.0).any():
            return False
        robots, count = rows[:, 0], len(self._rows)
        if count <= PER_MESSAGE:
            return len(robots) == count and bool((robots == self._rows[:, 0]).all())
        return bool(robots.min() >= 0.0 and robots.max() < count and not (robots % 1.0).any())

    def fits(self, rows: Array) -> bool:
        """Whether rows that a neighbour sent have the right shape."""
        most = min(len(self._rows), PER_MESSAGE)
        return rows.ndim == 2 and 0 < len(rows) <= most and rows.shape[1] == self._rows.shape[1]

    def rows(self, stamp: int) -> Array | None:
        """Every robot's row (N, width) if all bear this stamp, else None."""
        return self._rows[:, 2:].copy() if (self._rows[:, 1] == stamp).all() else None

    def row(self, robot: int) -> tuple[int, Array]:
        """The newest row of one robot, and its stamp, -1 if there is none."""
        return int(self._rows[robot, 1]), self._rows[robot, 2:].copy()

    @property
    def newest(self) -> int:
        """The largest stamp of all rows, -1 if there are none."""
        return self._newest

    @property
    def table(self) -> Array:
        """All rows, shape (N, 1 + width): stamps first."""
        return self._rows[:, 1:].copy()

    @property
    def digest(self) -> float:
        """Checksum of the stamps: a sum would be the same for two tables each with a row that the other lacks."""
        if self._digest is None:
            self._digest = float(zlib.crc32(self._rows[:, 1].tobytes()))
        return self._digest

    def told(self) -> Array | None:
        """What to send to the neighbours: rows (k, 2 + width) that begin with the robot's number and the stamp.

        None if they all know everything.
        """
        digest = self.digest
        if all(heard == digest for heard in self._heard.values()):
            self.note_all_know()
            return None
        return self._rows[self._next_rows()] if len(self._rows) > PER_MESSAGE else self._rows.copy()

    def note_all_know(self) -> None:
        """All neighbours know everything: nothing is news to them."""
        self._news.clear()

    def _next_rows(self) -> list[int]:
        """Of a large table."""
        chosen = list(islice(self._news, PER_MESSAGE))
        for robot in chosen:
            del self._news[robot]
        while len(chosen) < PER_MESSAGE:
            chosen.append(self._turn)
            self._turn = (self._turn + 1) % len(self._rows)
        return chosen


class Floods:
    """Several tables that travel together, by name."""

    def __init__(self, tables: Mapping[str, Flood]) -> None:
        self._tables = dict(tables)
        self._heard: dict[str, list[float]] = {}

    def hear(self, neighbour: str, channels: Mapping[str, Array]) -> None:
        """Take in a neighbour's ``channels``."""
        digests = channels.get("digests")
        if digests is None or digests.shape != (len(self._tables),):
            return
        heard = digests.tolist()
        if heard == self._heard.get(neighbour) == self._digests():
            return  # as usual: it knows what we know
        self._heard[neighbour] = heard
        for digest, (name, flood) in zip(heard, self._tables.items(), strict=True):
            flood.hear(neighbour, digest, channels.get(name))

    def fit(self, channels: Mapping[str, Array]) -> bool:
        """Whether what a neighbour sent of these tables, if anything, has the right shapes."""
        digests = channels.get("digests")
        return (digests is None or digests.shape == (len(self._tables),)) and all(
            self._tables[name].fits(channels[name]) for name in channels.keys() & self._tables.keys()
        )

    def channels(self) -> dict[str, Array]:
        """What to send to the neighbours."""
        digests = self._digests()
        told = {"digests": np.array(digests)}
        if all(heard == digests for heard in self._heard.values()):
            for flood in self._tables.values():
                flood.note_all_know()
            return told
        for name, flood in self._tables.items():
            rows = flood.told()
            if rows is not None:
                told[name] = rows
        return told

    def _digests(self) -> list[float]:
        return [flood.digest for flood in self._tables.values()]
