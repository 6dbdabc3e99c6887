"""Moments over those samples that every robot of the team has.

Poses of a team are fitted to sums over samples, each robot's to its own. Where messages are lost, not everybody has the
same samples, and what errors of the common body motion would cancel between robots does not: a fit to sums over
different samples is far worse than it believes. So robots tell each other which blocks they have, a chunk of steps at a
time, and count only what all of them have.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coheft.estimation.registration import RegistrationMoments
from coheft.estimation.spatial import Array
from consensus.flood import Flood

_MOST_BITS = 48
"""As many fit into a number of a table."""


class CommonMoments:
    """One robot's moments.

    Args:
        robots: Number of robots.
        own: Index of this one.
        start: First step.
        chunk: Steps per chunk, as far as that many fit.
        parts: Blocks per step.

    Attributes:
        total: Over all chunks that are agreed upon.
        chunks: Number of chunks that are agreed upon.
        flood: Tells the others, and hears them: per robot the blocks of the chunk before, and of the present one.
    """

    def __init__(self, robots: int, own: int, start: int, chunk: int, parts: int) -> None:
        self.total = RegistrationMoments.none()
        self.chunks = 0
        self.flood = Flood(robots, 2)
        self._own = own
        self._start = start
        self._parts = parts
        self._size = min(chunk, _MOST_BITS // parts)
        self._pending: dict[int, RegistrationMoments] = {}
        self._mask_before = 0

    @property
    def chunk_size(self) -> int:
        """Steps per chunk."""
        return self._size

    def add(self, step: int, blocks: Sequence[RegistrationMoments | None]) -> None:
        """Take in what a step has given: moments of ``parts`` blocks, None for each that is missing."""
        for part, moments in enumerate(blocks):
            if moments is not None:
                self._pending[(step - self._start) * self._parts + part] = moments
        while len(self._pending) > _MOST_BITS * self._parts:
            self._pending.pop(min(self._pending))  # nobody answers: this will not be counted

    def agree(self, step: int) -> bool:
        """Count the next chunk if everybody has told what it has of it; returns whether that was so.

        Args:
            step: The present step, which ``add`` was called for.
        """
        bits, first = self._size * self._parts, self.chunks * self._size
        if step - self._start < first + self._size - 1:
            return False
        stamp, row = self.flood.row(self._own)
        if stamp < self.chunks:
            row = np.array([float(self._mask_before), float(self._mask(first, bits))])
            self.flood.tell(self._own, self.chunks, row)
        common = self._common(bits)
        if common is None:
            return False
        self._mask_before = int(row[1])
        for bit in range(bits):
            moments = self._pending.pop(first * self._parts + bit, None)
            if moments is not None and common >> bit & 1:
                self.total += moments
        self.chunks += 1
        return True

    def _mask(self, first: int, bits: int) -> int:
        return sum(1 << bit for bit in range(bits) if first * self._parts + bit in self._pending)

    def _common(self, bits: int) -> int | None:
        """Blocks of the present chunk that everybody has; None while somebody has not told."""
        common = (1 << bits) - 1
        for stamp, before, present in self.flood.table:
            if stamp not in (self.chunks, self.chunks + 1):
                return None
            common &= int(present if stamp == self.chunks else before)
        return common

    def map(self, feature_map: Array) -> None:
        """Everything, as if every sample's features had been ``feature_map`` (28, 28) times what they were."""
        self.total = self.total.mapped(feature_map)
        self._pending = {key: moments.mapped(feature_map) for key, moments in self._pending.items()}
