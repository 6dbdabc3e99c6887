"""Selection of neighbours' messages: which of them are used, and for which block.

Messages may be late, duplicated, out of order, from before the sender restarted, or invalid. Messages of the previous
block are used, late ones by some estimators, too. Invalid messages are refused with a reason. Who steps the agent keeps
messages that come early until their block.
"""

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import msgspec
import numpy as np

from coheft.agents.estimator import Channels
from coheft.estimation.geometry.spatial import Array
from coheft.wire.messages.structs import LinkState, NeighbourMessage
from coheft.wire.scenario.schema import MAX_ROBOTS

_INCARNATION_LIFETIME = 8
"""After this number of blocks without a usable message of a sender's latest incarnation, a current message with a
smaller incarnation is accepted: the larger number was an error."""
LATE = 64
"""Number of blocks by which a message may be late to be of use to an estimator that takes late ones."""
LARGEST_NORM = 1e12
"""Limit of the norm of every array that an estimator sends."""


class Taken(NamedTuple):
    """Messages to use for a block.

    Attributes:
        used: The neighbours' messages of the previous block, in the order of names.
        gossip: The records of all valid messages.
        problems: Descriptions of refused messages.
        late: Their messages of earlier blocks that arrive only now.
    """

    used: dict[str, NeighbourMessage]
    gossip: list[LinkState]
    problems: list[str]
    late: list[NeighbourMessage]


class NeighbourInbox:
    """Received messages of one agent's neighbours."""

    def __init__(self, neighbours: Iterable[str]) -> None:
        self._incarnations = dict.fromkeys(sorted(neighbours), 0)
        self._last: dict[str, int] = {}
        # Blocks of the messages of the latest incarnation that were used; a late one may be of any of ``LATE``.
        self._used = {name: deque[int](maxlen=2 * LATE) for name in self._incarnations}
        self._misfits: set[str] = set()
        self._checked: dict[str, LinkState] = {}

    def take(
        self,
        index: int,
        messages: Sequence[NeighbourMessage],
        fits: Callable[[Channels], bool] = lambda _: True,
        takes_late: bool = False,
    ) -> Taken:
        """Return the messages to use for a block.

        Args:
            index: The block's number; grows from call to call.
            messages: All messages received since the last call.
            fits: Whether the estimator can read a message's channels. Of several messages of the same sender and block,
                the first one that fits is used.
            takes_late: Whether the estimator can use messages of earlier blocks; copies are left out.
        """
        if not self._last:
            self._last = dict.fromkeys(self._incarnations, index)  # silence is counted from the first block on
        used: dict[str, NeighbourMessage] = {}
        gossip: list[LinkState] = []
        problems: list[str] = []
        late: list[NeighbourMessage] = []
        for message in sorted(messages, key=lambda message: (message.sender, message.incarnation, message.block)):
            name = message.sender
            problem = self._problem(index, message)
            if problem is not None:
                problems.append(f"refused from {name}, block {message.block}: {problem}")
                continue
            if message.incarnation != self._incarnations[name]:
                self._incarnations[name] = message.incarnation
                self._used[name].clear()
                used.pop(name, None)
            gossip += message.gossip
            is_late = takes_late and self._is_late(index, message)
            if not is_late and (message.block != index - 1 or name in used):
                continue
            if fits(message.channels):
                self._used[name].append(message.block)
                self._last[name] = index
                if is_late:
                    late.append(message)
                else:
                    used[name] = message
            elif not is_late and name not in self._misfits:
                self._misfits.add(name)  # reported once
                problems.append(
                    f"refused from {name}, block {index - 1}: this robot's estimator cannot read its arrays; "
                    f"run the same release of coheft, and the same estimator, on all robots"
                )
        return Taken(used, gossip, problems, late)

    def last_heard(self, name: str) -> int:
        """Return the last block for which a message of this neighbour was used, or the first block if there was
        none.
        """
        return self._last[name]

    def _is_late(self, index: int, message: NeighbourMessage) -> bool:
        """Whether a message comes too late, and none of its block has been used."""
        is_late = index - 1 - LATE <= message.block < index - 1
        return is_late and message.block not in self._used[message.sender]

    def _problem(self, index: int, message: NeighbourMessage) -> str | None:
        """Return why a message is invalid, None if it is valid."""
        known = self._incarnations.get(message.sender)
        if known is None:
            return f"it is not a neighbour; neighbours are {', '.join(self._incarnations)}"
        is_error = index - self._last[message.sender] >= _INCARNATION_LIFETIME and message.block >= index - 1
        if message.incarnation < (0 if is_error else known):
            return "it was sent before its sender restarted"
        if message.block >= index:
            return f"it is {message.block - index + 1} blocks ahead"
        if message.block < 0:
            return "its block is negative, but the first one is 0"
        for name, array in message.channels.items():
            if not can_be_used(array):
                return f"channels[{name!r}] contains numbers that are not finite or not below {LARGEST_NORM:g}"
        for record in message.gossip:
            if record == self._checked.get(record.robot):
                continue  # most records are repeated
            if not is_possible(record):
                return f"its record of {record.robot!r} is impossible"
            if record.robot in self._checked or len(self._checked) < MAX_ROBOTS:
                self._checked[record.robot] = record
        return None


def can_be_used(array: Array) -> bool:
    """Whether all numbers of an array are finite, and small enough that their sums are finite."""
    if array.dtype.kind != "f":
        array = array.astype(np.float64)  # products of whole numbers may overflow
    return bool(np.vdot(array, array) < LARGEST_NORM**2)  # also false for NaN


def is_possible(record: LinkState) -> bool:
    """Whether a robot's record is what ``LinkState`` allows, and consistent in itself."""
    try:
        msgspec.convert(msgspec.to_builtins(record), LinkState)
    except (TypeError, msgspec.ValidationError):  # a user's estimator may have put in anything
        return False
    return record.robot not in record.neighbours
