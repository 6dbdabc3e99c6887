"""Seals in the secure profile: each robot signs what it has measured, so that rows changed on the way are found.

    seal of robot j = its signature over (team, j, number of the first row, a hash of each of S rows from there on)

Rows are forwarded by neighbours, and a link's certificate proves only who forwards them. So robots sign the hashes of
their newest rows a few times a second, and all robots forward these seals. Rows are used at once. Those that differ
from their seal, or whose seal does not arrive in time, are removed again.
"""

from __future__ import annotations

import hashlib
import math
import struct
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from coheft.agents.efficient.exchange import Copy, Exchange
from coheft.agents.efficient.row_times import RowTimes
from coheft.agents.efficient.settings import Guards
from coheft.agents.estimator import Channels, RowSigner
from coheft.wire.config import AgentConfig
from coheft.wire.messages.size import MOST_SEALED

_CHANNEL = "seals"
_HASH = 8
"""Length of a hash [B]: a forger would have to find another row with the same hash within a second."""
_LONGEST_SIGNATURE = 72
"""Longest signature of ECDSA on P-256, in DER [B]."""
_HEAD = struct.Struct("<3i")
"""Index of the robot, number of the first row, length of the signature."""
_REPEATED = 2
"""At least so many seals in a message are known already."""


class Seal(NamedTuple):
    """A robot's signature of some of its rows.

    Attributes:
        robot: Index of the robot.
        first: Number of the first row.
        hashes: Of the rows from there on, ``_HASH`` bytes each; zero where the robot has no row.
        signature: The robot's.
    """

    robot: int
    first: int
    hashes: bytes
    signature: bytes = b""

    def content(self, team: int) -> bytes:
        """Return the bytes that are signed."""
        return struct.pack("<Iii", team, self.robot, self.first) + self.hashes

    def confirms(self, number: int, row: bytes) -> bool:
        """Whether the robot has measured this row."""
        index = _HASH * (number - self.first)
        return self.hashes[index : index + _HASH] == _hash_of(row)

    def encode(self) -> bytes:
        """Return bytes; their length depends only on the number of rows."""
        head = _HEAD.pack(self.robot, self.first, len(self.signature))
        return head + self.signature.ljust(_LONGEST_SIGNATURE, b"\0") + self.hashes

    @staticmethod
    def decode(data: bytes) -> Seal:
        """Inverse of ``encode``. From other bytes it makes a seal that no robot has signed."""
        robot, first, length = _HEAD.unpack_from(data)
        end = _HEAD.size + _LONGEST_SIGNATURE
        return Seal(robot, first, data[end:], data[_HEAD.size : end][: max(0, length)])


def _hash_of(row: bytes | None) -> bytes:
    return bytes(_HASH) if row is None else hashlib.blake2b(row, digest_size=_HASH).digest()


@dataclass(frozen=True)
class SealTimes:
    """When seals are made and expected.

    Attributes:
        span: Number of rows of a seal, ``S``.
        patience: Number of blocks within which a seal has to arrive after the last of its rows.
        distrust: Number of blocks for which a neighbour's copies of a robot's rows are not used after a false one.
    """

    span: int
    patience: int
    distrust: int

    @staticmethod
    def of_team(count: int, hops: int, times: RowTimes, config: AgentConfig, guards: Guards) -> SealTimes:
        """Choose them for ``count`` robots, the farthest of them ``hops`` away."""
        every = guards.sealed_every * max(1.0, count / guards.sealed_alike)
        span = min(max(1, round(every * config.rate / times.row)), MOST_SEALED)
        return SealTimes(span, config.blocks(guards.sealed_within) + hops, config.blocks(guards.distrusting))

    def window(self, times: RowTimes) -> int:
        """Number of blocks for which rows are needed to be compared with their seals."""
        return times.last_block(self.span) + self.patience + 1


class Seals:
    """One robot's seals of its team's rows from the number ``start`` on, and the comparison of these rows with them."""

    def __init__(
        self,
        names: Sequence[str],
        own: int,
        start: int,
        exchange: Exchange,
        times: RowTimes,
        seal_times: SealTimes,
        signer: RowSigner,
    ) -> None:
        self._names, self._own, self._exchange, self._times = names, own, exchange, times
        self._span = span = seal_times.span
        self._patience, self._distrust, self._signer = seal_times.patience, seal_times.distrust, signer
        self._nothing = Seal(-1, 0, bytes(_HASH * span)).encode()
        self._size = len(self._nothing)
        self._known: dict[tuple[int, int], Seal] = {}  # by robot and number of the first row
        self._fresh: list[Seal] = []  # not compared with rows yet
        self._absent: set[tuple[int, int]] = set()  # robot and number of rows that have a seal, but are not here
        self._news = deque[bytes]()  # encoded
        self._newest: dict[int, tuple[int, bytes]] = {}  # by robot: number of the first row, the seal encoded
        self._turn = 0
        self._per_message = math.ceil(len(names) / (1 + times.last_block(span))) + _REPEATED
        self._due = [self._first_of(robot, start) for robot in range(len(names))]  # the seals to arrive next
        self._note_due()
        self._unsealed: set[int] = set()  # robots whose last seal has not arrived
        self._used = deque[int](maxlen=2 * exchange.window * max(1, times.complete(0)))
        self._refused: list[str] = []

    def _note_due(self) -> None:
        self._last_due = max(self._due)
        self._judged_next = self._patience + min(self._times.last_block(due + self._span - 1) for due in self._due)

    def _first_of(self, robot: int, number: int) -> int:
        """Number of the first row of a row's seal. Robots take turns to sign."""
        offset = robot * self._span // len(self._names)
        return (number + offset) // self._span * self._span - offset

    def _seal_of(self, robot: int, number: int) -> Seal | None:
        return self._known.get((robot, self._first_of(robot, number)))

    def _hashes(self, robot: int, first: int) -> bytes:
        """Hashes of a robot's rows in the exchange that belong to one seal."""
        row = self._exchange.row
        return b"".join([_hash_of(row(robot, number)) for number in range(first, first + self._span)])

    # --- messages ---

    def seal(self, number: int) -> None:
        """Sign this robot's rows before ``number``, which is its newest one, as far as they fill a seal."""
        own, span = self._own, self._span
        while self._due[own] + span <= number:
            first = self._due[own]
            unsigned = Seal(own, first, self._hashes(own, first))
            self._keep(unsigned._replace(signature=self._signer.sign(unsigned.content(self._exchange.team))))
            self._due[own] += span

    def receive(self, channels: Channels, block: int) -> None:
        """Process the seals in a neighbour's message. After one that is not signed, the rest is ignored."""
        array = channels.get(_CHANNEL)
        if array is None or array.dtype != np.int32 or array.ndim != 2 or array.shape[1] * array.itemsize != self._size:
            return
        newest = self._times.complete(block - 1)
        for index, (robot, first) in enumerate(array[:, :2].tolist()):
            if not 0 <= robot < len(self._names) or not self._due[robot] <= first < newest:
                continue
            if (robot, first) in self._known or first != self._first_of(robot, first):
                continue
            seal = Seal.decode(array[index].tobytes())
            if not self._signer.is_signed_by(self._names[robot], seal.content(self._exchange.team), seal.signature):
                return
            self._keep(seal)

    def _keep(self, seal: Seal) -> None:
        self._known[seal.robot, seal.first] = seal
        self._fresh.append(seal)
        encoded = seal.encode()
        self._news.append(encoded)
        self._newest[seal.robot] = max(self._newest.get(seal.robot, (seal.first, encoded)), (seal.first, encoded))

    def channels(self) -> dict[str, npt.NDArray[np.int32]]:
        """Return the channel with seals for all neighbours: new ones, and known ones in rotation, in case one was lost.

        They are always as many, because messages whose arrays keep their shapes are decoded faster.
        """
        sent = [self._news.popleft() for _ in range(min(len(self._news), self._per_message))]
        known = list(self._newest.values())
        while len(sent) < self._per_message:
            self._turn += 1
            sent.append(known[self._turn % len(known)][1] if known else self._nothing)
        return {_CHANNEL: np.frombuffer(b"".join(sent), dtype=np.int32).reshape(len(sent), self._size // 4)}

    # --- comparison ---

    def may_use(self, number: int) -> bool:
        """Whether rows with this number may be used: before their seals are due, unless the robot's last one was
        missing, and after that only with their seals.
        """
        if number >= self._last_due and not self._unsealed:
            return True
        return all(
            (number >= due and robot not in self._unsealed) or self._seal_of(robot, number) is not None
            for robot, due in enumerate(self._due)
            if robot != self._own
        )

    def note_use(self, number: int) -> None:
        """Note that the rows with this number are in use."""
        self._used.append(number)

    def refused(self) -> list[str]:
        """Return what has been refused since the last call, in words."""
        refused, self._refused = self._refused, []
        return refused

    def check(self, block: int) -> int | None:
        """Compare rows with seals, and remove those that are false, or have no seal in time. Return the first of the
        numbers in use whose rows are not all right; None if there is none.
        """
        distrusted = self._exchange.distrusted
        for pair in [pair for pair, since in distrusted.items() if block - since > self._distrust]:
            del distrusted[pair]
        removed = [*self._without_seal(block), *self._false(block)]
        self._check_aside(block)
        used = [number for number in removed if number in self._used]
        if not used:
            return None
        first = min(used)
        for number in [number for number in self._used if number >= first]:
            self._used.remove(number)
        return first

    def _false(self, block: int) -> Iterator[int]:
        """Remove rows that differ from their seals; yield their numbers."""
        fresh, self._fresh = self._fresh, []
        wrong = [seal for seal in fresh if self._hashes(seal.robot, seal.first) != seal.hashes]
        numbers = [(seal.robot, seal.first + index) for seal in wrong for index in range(self._span)]
        for robot, number in [*sorted(self._absent), *numbers]:
            seal, row = self._seal_of(robot, number), self._exchange.row(robot, number)
            self._absent.discard((robot, number))
            if seal is None or (row is not None and seal.confirms(number, row)):
                continue
            self._absent.add((robot, number))
            if row is not None:
                for copy in self._exchange.remove(robot, number):
                    self._distrust_sender(copy, block)
                yield number

    def _check_aside(self, block: int) -> None:
        """Compare the copies that were set aside; those that are right replace missing rows."""
        for key, row in list(self._exchange.aside.items()):
            copy = Copy(*key, row)
            seal = self._seal_of(copy.robot, copy.number)
            if seal is None:
                continue
            del self._exchange.aside[key]
            if not seal.confirms(copy.number, copy.row):
                self._distrust_sender(copy, block)
            elif self._exchange.row(copy.robot, copy.number) is None:
                self._exchange.restore(copy)

    def _distrust_sender(self, copy: Copy, block: int) -> None:
        pair, whose = (copy.sender, copy.robot), self._names[copy.robot]
        if pair not in self._exchange.distrusted:
            since = self._times.first_block(copy.number)
            self._refused.append(
                f"refused from {copy.sender}: rows of {whose}, since block {since}, that {whose} has not signed"
            )
        self._exchange.distrusted[pair] = block

    def _without_seal(self, block: int) -> Iterator[int]:
        """Remove rows whose seal has not arrived in time, and forget old seals; yield the numbers of these rows."""
        if block < self._judged_next:
            return
        oldest = self._times.begun_from(max(0, block - self._exchange.window)) - self._span
        while self._known and next(iter(self._known.values())).first < oldest:
            del self._known[next(iter(self._known))]
        for robot in range(len(self._names)):
            while self._times.last_block(self._due[robot] + self._span - 1) + self._patience <= block:
                first = self._due[robot]
                self._due[robot] += self._span
                if (robot, first) in self._known:
                    self._unsealed.discard(robot)
                    continue
                rows = [n for n in range(first, first + self._span) if self._exchange.row(robot, n) is not None]
                if rows and robot != self._own:
                    if robot not in self._unsealed:
                        name, since = self._names[robot], self._times.first_block(rows[0])
                        self._refused.append(f"rows of {name} since block {since} are not used: no signature has come")
                    self._unsealed.add(robot)
                    for number in rows:
                        self._exchange.remove(robot, number)
                    yield from rows
        self._note_due()
