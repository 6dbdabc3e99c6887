"""Tables with one row per robot, distributed to all robots by flooding."""

import zlib
from collections.abc import Mapping
from itertools import islice

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.wire.messages.limits import PER_MESSAGE


class Flood:
    """One agent's copy of a table with a row per robot; the row with the highest stamp wins.

    A row reaches all agents in as many blocks as the graph's diameter. Agents always send each other a checksum of
    their stamps. They add rows while a neighbour's checksum is known to differ from their own: usually in two messages,
    and again after a lost message.
    If a table has more than ``PER_MESSAGE`` rows, a message holds new rows first, in order of arrival, then others in
    rotation; rows that do not fit follow in the next messages.

    Use it for each block: ``receive`` what every neighbour has sent, ``enter`` own rows, then send ``digest`` and
    ``sent()`` to all neighbours.

    Args:
        robots: Number of robots.
        width: Numbers per row.
    """

    def __init__(self, robots: int, width: int) -> None:
        # Columns as sent: the robot's number, the stamp, the content.
        self._rows = np.full((robots, 2 + width), -1.0)
        self._rows[:, 0] = np.arange(robots)
        self._received: dict[str, float] = {}
        self._unsent: dict[int, None] = {}
        self._next = 0
        self._digest: float | None = None
        self._newest = -1

    def enter(self, robot: int, stamp: int, row: Array) -> None:
        """Enter a row of the table: the robot's own, or one that it has computed for another robot."""
        self._rows[robot, 1], self._rows[robot, 2:] = stamp, row
        self._unsent[robot] = None
        self._update_stamps()

    def receive(self, neighbour: str, digest: float | None, rows: Array | None) -> None:
        """Process a neighbour's message: its ``digest``, and the rows that it sent, if any."""
        if digest is not None:
            self._received[neighbour] = digest
        if rows is None or digest == self.digest or not self.fits(rows) or not self._are_valid(rows):
            return
        robots = rows[:, 0].astype(np.int64)
        newer = rows[:, 1] > self._rows[robots, 1]
        if newer.any():
            self._rows[robots[newer]] = rows[newer]
            self._unsent |= dict.fromkeys(robots[newer].tolist())
            self._update_stamps()

    def _update_stamps(self) -> None:
        """Update what depends on the stamps."""
        self._digest, self._newest = None, int(self._rows[:, 1].max())

    def _are_valid(self, rows: Array) -> bool:
        """Whether received rows are valid: stamps are whole numbers, robots exist; a small table is complete and in
        order.
        """
        if (rows[:, 1] % 1.0).any():
            return False
        robots, count = rows[:, 0], len(self._rows)
        if count <= PER_MESSAGE:
            return len(robots) == count and bool((robots == self._rows[:, 0]).all())
        return bool(robots.min() >= 0.0 and robots.max() < count and not (robots % 1.0).any())

    def fits(self, rows: Array) -> bool:
        """Whether rows received from a neighbour have the right shape."""
        most = min(len(self._rows), PER_MESSAGE)
        return rows.ndim == 2 and 0 < len(rows) <= most and rows.shape[1] == self._rows.shape[1]

    def rows(self, stamp: int) -> Array | None:
        """Return the rows of all robots (N, width) if all have this stamp, else None."""
        return self._rows[:, 2:].copy() if (self._rows[:, 1] == stamp).all() else None

    def row(self, robot: int) -> tuple[int, Array]:
        """Return the newest row of one robot, and its stamp, -1 if there is none."""
        return int(self._rows[robot, 1]), self._rows[robot, 2:].copy()

    @property
    def newest(self) -> int:
        """The largest stamp of all rows, -1 if there are none."""
        return self._newest

    @property
    def table(self) -> Array:
        """All rows, shape (N, 1 + width), with the stamps in the first column."""
        return self._rows[:, 1:].copy()

    @property
    def digest(self) -> float:
        """Checksum of the stamps. A sum would not distinguish two tables that each lack a row of the other."""
        if self._digest is None:
            self._digest = float(zlib.crc32(self._rows[:, 1].tobytes()))
        return self._digest

    def sent(self) -> Array | None:
        """Return rows for the next message, shape (k, 2 + width): the robot's number, the stamp, the content.

        None if all neighbours have the same table.
        """
        digest = self.digest
        if all(received == digest for received in self._received.values()):
            self.note_all_know()
            return None
        return self._rows[self._next_rows()] if len(self._rows) > PER_MESSAGE else self._rows.copy()

    def note_all_know(self) -> None:
        """Record that all neighbours have the same table, so that no row is new to them."""
        self._unsent.clear()

    def _next_rows(self) -> list[int]:
        """Return the indices of the ``PER_MESSAGE`` rows to send of a large table."""
        chosen = list(islice(self._unsent, PER_MESSAGE))
        for robot in chosen:
            del self._unsent[robot]
        while len(chosen) < PER_MESSAGE:
            chosen.append(self._next)
            self._next = (self._next + 1) % len(self._rows)
        return chosen


class Floods:
    """Several named tables whose rows travel in the same messages."""

    def __init__(self, tables: Mapping[str, Flood]) -> None:
        self._tables = dict(tables)
        self._received: dict[str, list[float]] = {}

    def receive(self, neighbour: str, channels: Mapping[str, Array]) -> None:
        """Process a neighbour's ``channels``."""
        digests = channels.get("digests")
        if digests is None or digests.shape != (len(self._tables),):
            return
        received = digests.tolist()
        if received == self._received.get(neighbour) == self._digests():
            return  # the usual case: the neighbour has the same tables
        self._received[neighbour] = received
        for digest, (name, flood) in zip(received, self._tables.items(), strict=True):
            flood.receive(neighbour, digest, channels.get(name))

    def fit(self, channels: Mapping[str, Array]) -> bool:
        """Whether the arrays that a neighbour sent for these tables, if any, have the right shapes."""
        digests = channels.get("digests")
        return (digests is None or digests.shape == (len(self._tables),)) and all(
            self._tables[name].fits(channels[name]) for name in channels.keys() & self._tables.keys()
        )

    def channels(self) -> dict[str, Array]:
        """Return the arrays to send to all neighbours."""
        digests = self._digests()
        sent = {"digests": np.array(digests)}
        if all(received == digests for received in self._received.values()):
            for flood in self._tables.values():
                flood.note_all_know()
            return sent
        for name, flood in self._tables.items():
            rows = flood.sent()
            if rows is not None:
                sent[name] = rows
        return sent

    def _digests(self) -> list[float]:
        return [flood.digest for flood in self._tables.values()]
