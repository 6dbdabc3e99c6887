"""Moments over those samples that every robot of the team has.

Poses of a team are fitted to sums over samples, each robot's to its own. Where messages are lost, not everybody has the
same samples, and what errors of the common body motion would cancel between robots does not: a fit to sums over
different samples is far worse than it believes. So robots tell each other which blocks they have, a chunk of steps at a
time, and count only what all of them have. If one of them says that something contradicts the team's motion, the chunks
of late, in which it went unnoticed, do not count. If one of them says that all samples come again, what was counted
before is forgotten.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from coheft.estimation.registration import RegistrationMoments
from coheft.estimation.spatial import Array
from consensus.flood import Flood

_TOLD = 3
"""Numbers that robots tell of a chunk beside which blocks of it they have."""
_BITS = 32
"""As many are in a number of a table; with 40 it could be larger than any that neighbours take (``agents.inbox``)."""


class CommonMoments:
    """One robot's moments.

    A chunk is agreed upon when everybody has told which of its blocks it has, and from which step on the next chunk
    might begin: it begins at the latest of these. So nobody has to go through chunks for which nobody could be heard.

    Args:
        robots: Number of robots.
        own: Index of this one.
        start: First step.
        chunk: Steps per chunk: more than it takes to hear from everybody.
        parts: Blocks per step.
        unsure: For so many chunks something may be wrong without being noticed.

    Attributes:
        chunks: Number of chunks that are agreed upon.
        steps: Step, counted from the first, at which the next one begins.
        forgotten: Number of samples that had counted when all came again last.
        left_out: Blocks that came since the last agreement and could not be told of.
        is_spoilt: Whether somebody said with the last one that something is wrong.
        has_forgotten: Whether the samples before it do not count any more.
        flood: Tells the others, and hears them: per robot what it says about the chunk before, and about the present.
    """

    def __init__(self, robots: int, own: int, start: int, chunk: int, parts: int, unsure: int) -> None:
        self._words = -(-chunk * parts // _BITS)
        self._sure = RegistrationMoments.none()
        self._unsure: deque[RegistrationMoments] = deque([RegistrationMoments.none()] * unsure, maxlen=unsure)
        self._spoilt_step = -1
        self.is_spoilt = self.has_forgotten = False
        self._again, self._told_again = 0, 0
        self.forgotten = 0.0
        self.chunks = self.steps = self.left_out = 0
        self.flood = Flood(robots, 2 * (_TOLD + self._words))
        self._own = own
        self._start = start
        self._chunk = chunk
        self._parts = parts
        self._pending: dict[int, RegistrationMoments] = {}
        self._told_before = np.zeros(_TOLD + self._words)

    def add(self, step: int, blocks: Sequence[RegistrationMoments | None]) -> None:
        """Take in what a step has given: moments of ``parts`` blocks, None for each that is missing."""
        for part, moments in enumerate(blocks):
            # While nobody answers, not more than can be told of: what comes later is not counted.
            if moments is None:
                continue
            if len(self._pending) < 2 * self._chunk * self._parts:
                self._pending[(step - self._start) * self._parts + part] = moments
            else:
                self.left_out += 1

    @property
    def total(self) -> RegistrationMoments:
        """Over all chunks that are agreed upon."""
        return sum(self._unsure, self._sure)

    def spoil(self, step: int) -> None:
        """Something contradicts the team's motion at a step, and may have done so for a while."""
        self._spoilt_step = step - self._start

    def begin_again(self, step: int) -> None:
        """From this step on all samples come again: those of steps before are not to count any more."""
        self._told_again = step - self._start

    def agree(self, step: int) -> bool:
        """Count the next chunk if everybody has told what it has of it; returns whether that was so.

        Args:
            step: The present step, which ``add`` was called for.
        """
        passed = step - self._start + 1
        if passed < self.steps + self._chunk:
            return False
        stamp, row = self.flood.row(self._own)
        if stamp < self.chunks:
            # Only whole chunks, so that robots that are a step or two apart propose the same.
            following = self.steps + (passed - self.steps) // self._chunk * self._chunk
            present = [following, float(self.steps <= self._spoilt_step), self._told_again]
            row = np.concatenate([self._told_before, present, self._mask()])
            self.flood.tell(self._own, self.chunks, row)
        told = self._told()
        if told is None:
            return False
        self._told_before = row[len(row) // 2 :]
        self._forget(int(told[:, 2].max()))
        common = np.bitwise_and.reduce(told[:, _TOLD:].astype(np.int64), axis=0)
        first, self.steps = self.steps * self._parts, int(told[:, 0].max())
        chunk = RegistrationMoments.none()
        for key in [key for key in self._pending if key < self.steps * self._parts]:
            moments, (word, bit) = self._pending.pop(key), divmod(key - first, _BITS)
            is_told = 0 <= key - first < self._chunk * self._parts and key >= self._again * self._parts
            if is_told and common[word] >> bit & 1:
                chunk += moments
        self.is_spoilt = bool(np.any(told[:, 1] > 0.0))
        if self.is_spoilt:
            chunk = RegistrationMoments.none()
            self._unsure.extend([chunk] * len(self._unsure))
        else:
            self._sure += self._unsure[0]
            self._unsure.append(chunk)
        self.chunks, self.left_out = self.chunks + 1, 0
        return True

    def _forget(self, again: int) -> None:
        """What came before a step, if that is news."""
        self.has_forgotten = again > self._again
        if self.has_forgotten:
            self._again, self.forgotten = again, self.total.count
            self._sure = RegistrationMoments.none()
            self._unsure.extend([RegistrationMoments.none()] * len(self._unsure))

    def _mask(self) -> Array:
        words = np.zeros(self._words)
        for key in range(self._chunk * self._parts):
            if self.steps * self._parts + key in self._pending:
                words[key // _BITS] += float(1 << key % _BITS)
        return words

    def _told(self) -> Array | None:
        """What everybody says about the present chunk; None while somebody has not told."""
        stamps, rows = self.flood.table[:, 0], self.flood.table[:, 1:]
        is_ahead = stamps == self.chunks + 1
        if not np.all((stamps == self.chunks) | is_ahead):
            return None
        before, present = np.split(rows, 2, axis=1)
        return np.where(is_ahead[:, None], before, present)

    def map(self, feature_map: Array) -> None:
        """Everything, as if every sample's features had been ``feature_map`` (28, 28) times what they were."""
        self._sure = self._sure.mapped(feature_map)
        self._unsure.extend([moments.mapped(feature_map) for moments in self._unsure])
        self._pending = {key: moments.mapped(feature_map) for key, moments in self._pending.items()}
