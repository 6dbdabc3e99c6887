"""Numbers that every robot has of its own and all want to know: handed on from neighbour to neighbour."""

from __future__ import annotations

import zlib
from collections.abc import Mapping

import numpy as np

from coheft.estimation.spatial import Array


class Flood:
    """One agent's copy of a table with a row per robot; the row with the highest stamp wins.

    A row reaches everybody in as many blocks as the graph's diameter. Agents always tell each other a checksum of their
    stamps, and the table itself only while a neighbour's is another one: nothing is sent in vain, and what is lost is
    sent again.

    Args:
        robots: Number of robots.
        width: Numbers per row.
    """

    def __init__(self, robots: int, width: int) -> None:
        self._table = np.full((robots, 1 + width), -1.0)
        self._heard: dict[str, float] = {}

    def tell(self, robot: int, stamp: int, row: Array) -> None:
        """Put in the own row."""
        self._table[robot, 0], self._table[robot, 1:] = stamp, row

    def hear(self, neighbour: str, digest: float | None, table: Array | None) -> None:
        """Take in what a neighbour told: its ``digest``, and its table if it sent one."""
        if digest is not None:
            self._heard[neighbour] = digest
        if table is not None and table.shape == self._table.shape and not np.any(table[:, 0] % 1.0):
            newer = table[:, 0] > self._table[:, 0]
            self._table[newer] = table[newer]

    def rows(self, stamp: int) -> Array | None:
        """Everybody's row (N, width) if all bear this stamp, else None."""
        return self._table[:, 1:].copy() if np.all(self._table[:, 0] == stamp) else None

    def row(self, robot: int) -> tuple[int, Array]:
        """The newest row of one robot, and its stamp, -1 if there is none."""
        return int(self._table[robot, 0]), self._table[robot, 1:].copy()

    @property
    def table(self) -> Array:
        """All rows, shape (N, 1 + width): stamps first."""
        return self._table.copy()

    @property
    def digest(self) -> float:
        """Checksum of the stamps: a sum would be the same for two tables each with a row that the other lacks."""
        return float(zlib.crc32(self._table[:, 0].tobytes()))

    def told(self) -> Array | None:
        """What to send to the neighbours, shape (N, 1 + width), stamps first; None if they all know it."""
        if all(digest == self.digest for digest in self._heard.values()):
            return None
        return self.table


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
            name not in channels or channels[name].shape == flood.table.shape for name, flood in self._tables.items()
        )

    def channels(self) -> dict[str, Array]:
        """What to send to the neighbours."""
        told = {"digests": np.array([flood.digest for flood in self._tables.values()])}
        for name, flood in self._tables.items():
            table = flood.told()
            if table is not None:
                told[name] = table
        return told
