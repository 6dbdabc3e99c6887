"""Selection of neighbours' messages: which are used, and when.

Messages may come late, twice, out of order, from an agent's former life, or be nonsense. Those of the block before the
present one are used; those of the next few wait for their time. What cannot be right is refused, in words.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from coheft.agents.estimator import Channels
from coheft.estimation.geometry.spatial import Array
from coheft.wire.messages.structs import LinkState, NeighbourMessage
from coheft.wire.scenario.schema import MAX_ROBOTS

AHEAD = 8
"""A neighbour may be ahead by so many blocks: it got its measurements earlier."""
_SILENT = 8
"""When nothing with the number of a sender's newest life has been used for so many blocks, and something with a smaller
one is of the present block, that number was an error."""
_ALIKE = 4
"""So many messages of the same sender and block are looked at."""
LARGEST_NORM = 1e12
"""No array that an estimator sends has a norm as large as this."""
_LARGEST_NUMBER = 2**62
"""No number of a record is as large that grows: there have to be larger ones that a message can hold."""
_LARGEST_CHECKSUM = 2**32
"""Nor any that is a checksum."""
_LONGEST_NAME = 32


class NeighbourInbox:
    """Messages of one agent's neighbours.

    Args:
        neighbours: Their names.
    """

    def __init__(self, neighbours: Iterable[str]) -> None:
        self._incarnations = dict.fromkeys(sorted(neighbours), 0)
        self._waiting: dict[tuple[str, int, int], list[NeighbourMessage]] = {}
        self._last: dict[str, int] = {}
        self._strange: set[str] = set()
        self._possible: dict[str, LinkState] = {}

    def take(
        self, index: int, messages: Sequence[NeighbourMessage], fits: Callable[[Channels], bool] = lambda _: True
    ) -> tuple[dict[str, NeighbourMessage], list[LinkState], list[str]]:
        """What to use for a block.

        Args:
            index: Its number; grows from call to call.
            messages: All that came since the last call.
            fits: Whether a message's channels have the shapes that are read; of several with the same sender and block
                the first one that does is used.

        Returns:
            The neighbours' messages of the block before, in the order of names; what they hand on about robots, from
            all messages that are right; what was refused and why.
        """
        if not self._last:
            self._last = dict.fromkeys(self._incarnations, index)  # no robot can have been heard before the first block
        gossip: list[LinkState] = []
        problems: list[str] = []
        for message in sorted(messages, key=lambda message: (message.sender, message.incarnation, message.block)):
            problem = self._problem(index, message)
            if problem is not None:
                problems.append(f"refused from {message.sender}, block {message.block}: {problem}")
                continue
            self._incarnations[message.sender] = message.incarnation
            gossip += message.gossip
            if message.block >= index - 1:
                waiting = self._waiting.setdefault((message.sender, message.incarnation, message.block), [])
                if len(waiting) < _ALIKE:
                    waiting.append(message)
        used = {}
        for name, incarnation in self._incarnations.items():
            found = self._waiting.get((name, incarnation, index - 1))
            fitting = next((message for message in found or () if fits(message.channels)), None)
            if fitting is not None:
                used[name], self._last[name] = fitting, index
                self._strange.discard(name)
            elif found and name not in self._strange:
                self._strange.add(name)  # told once, until something of it fits
                problems.append(
                    f"refused from {name}, block {index - 1}: its arrays are none that this robot's estimator reads; "
                    f"run the same release of coheft, and the same estimator, everywhere"
                )
        self._waiting = {key: waiting for key, waiting in self._waiting.items() if key[2] >= index}
        return used, gossip, problems

    def last_heard(self, name: str) -> int:
        """The last block for which a message of this neighbour was used, or the first one at all."""
        return self._last[name]

    def _problem(self, index: int, message: NeighbourMessage) -> str | None:
        """Why a message cannot be right, None if it can."""
        known = self._incarnations.get(message.sender)
        if known is None:
            return f"no neighbour; neighbours are {', '.join(self._incarnations)}"
        is_error = index - self._last[message.sender] >= _SILENT and message.block >= index - 1
        if message.incarnation < (0 if is_error else known):
            return "it is from before its sender started again"
        if message.block > index - 1 + AHEAD:
            return f"it is {message.block - index + 1} blocks ahead, of {AHEAD} that are allowed"
        for name, array in message.channels.items():
            if not can_be_used(array):
                return f"channels[{name!r}] holds numbers that are not finite, or not below {LARGEST_NORM:g}"
        for record in message.gossip:
            if record == self._possible.get(record.robot):
                continue  # the same one comes again and again
            if not is_possible(record):
                return f"what it says about {record.robot!r} is impossible"
            if record.robot in self._possible or len(self._possible) < MAX_ROBOTS:
                self._possible[record.robot] = record
        return None


def can_be_used(array: Array) -> bool:
    """Whether all numbers of an array are finite, and so small that sums of them are, too."""
    return bool(np.vdot(array, array) < LARGEST_NORM**2)  # false for what is not a number, too


def is_possible(record: LinkState) -> bool:
    """Whether a robot's record makes sense on its own."""
    if record.robot in record.neighbours:
        return False
    if not all(0 <= number < _LARGEST_NUMBER for number in (record.incarnation, record.sequence, record.since)):
        return False
    if not -1 <= record.ready_block < _LARGEST_NUMBER:
        return False
    if not 0 <= record.team < _LARGEST_CHECKSUM:
        return False
    if len(record.neighbours) > MAX_ROBOTS:
        return False
    return max(map(len, (record.robot, *record.neighbours))) <= _LONGEST_NAME
