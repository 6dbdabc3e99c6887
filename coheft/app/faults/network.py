"""The simulated network: lists of messages per agent and block, with all that can happen to them on their way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from coheft.app.faults.messages import flip_bits, is_refused_in_another_run, lie_about, malformed
from coheft.app.faults.schedule import (
    AnyFault,
    Corruption,
    Delay,
    Duplication,
    FaultSchedule,
    Lie,
    LinkFault,
    Loss,
    Malformed,
    Partition,
    Reordering,
    Replay,
)
from coheft.wire.messages.structs import NeighbourMessage

_ORDER_STREAM = 1
"""Marks the random stream of the order in which messages come."""

_Timed = list[tuple[int, NeighbourMessage]]
_Active = list[tuple[AnyFault, np.random.Generator]]


@dataclass(eq=False)
class _Link:
    """Messages from one agent to another.

    Attributes:
        under_way: With the block at which they come.
        extra: Besides them, those that must not make any difference.
        had: What came so far.
    """

    under_way: _Timed = field(default_factory=list)
    extra: _Timed = field(default_factory=list)
    had: list[NeighbourMessage] = field(default_factory=list)


class Network:
    """Carries messages along the edges of a graph; what is said after one block comes with the next.

    In which order the messages of one block come is random.

    Args:
        schedule: What happens to messages.
        graph: Neighbours of every agent.

    Attributes:
        harmless: Whether messages come that must not make any difference, see ``schedule.is_harmless``.
        refused: Number of messages that reached no agent because the codec refused them.
    """

    def __init__(self, schedule: FaultSchedule, graph: Mapping[str, Sequence[str]]) -> None:
        self.harmless = True
        self._graph = graph
        self._block_duration = schedule.scenario.block_duration
        self._faults = [(fault, np.random.default_rng(fault.seed)) for fault in schedule.faults]
        self._order = np.random.default_rng([schedule.seed, _ORDER_STREAM])
        self._links = {(sender, receiver): _Link() for receiver in graph for sender in graph[receiver]}
        self.refused = 0

    def post(self, block: int, message: NeighbourMessage) -> None:
        """An agent says something to all its neighbours after a block."""
        active = self._active(block)
        for fault, rng in active:
            if isinstance(fault, Lie) and fault.robot == message.sender:
                message = lie_about(message, fault, rng)
        for receiver in self._graph[message.sender]:
            self._send(block, message, receiver, active)

    def collect(self, block: int, receiver: str) -> list[NeighbourMessage]:
        """All that has come to an agent until a block, in random order."""
        inbox: list[NeighbourMessage] = []
        for sender in self._graph[receiver]:
            link = self._links[sender, receiver]
            replayed = self._replayed(block, sender, receiver)
            came = _take(link.under_way, block)
            link.had += came
            inbox += came
            if self.harmless:
                inbox += replayed + _take(link.extra, block)
        return [inbox[k] for k in self._order.permutation(len(inbox))]

    def forget(self, block: int, receiver: str) -> None:
        """An agent starts anew with a block: what came before is gone, and it has not had it.

        So copies of it that were still to come would not be copies any more, but news.
        """
        for sender in self._graph[receiver]:
            link = self._links[sender, receiver]
            _take(link.under_way, block - 1)
            link.extra.clear()
            link.had.clear()

    def _active(self, block: int) -> _Active:
        time = block * self._block_duration
        return [(fault, rng) for fault, rng in self._faults if fault.is_active(time)]

    def _send(self, block: int, message: NeighbourMessage, receiver: str, active: _Active) -> None:
        """One message on one link; every fault draws for it, whatever others have done to it."""
        link = self._links[message.sender, receiver]
        due, arrives = block + 1, True
        copies: list[int] = []
        for fault, rng in active:
            if isinstance(fault, Partition) and fault.separates(message.sender, receiver):
                arrives = False
            if not (isinstance(fault, LinkFault) and fault.concerns(message.sender, receiver)):
                continue
            match fault:
                case Loss():
                    arrives &= rng.random() >= fault.probability
                case Delay():
                    due += fault.blocks
                case Reordering():
                    due += int(rng.integers(fault.blocks + 1))
                case Corruption():
                    if rng.random() < fault.probability:
                        damaged = flip_bits(message, fault, rng)
                        self.refused += damaged is None
                        arrives &= damaged is not None
                        message = damaged or message
                case Duplication():
                    if rng.random() < fault.probability:
                        copies.append(int(rng.integers(fault.blocks + 1)))
                case Malformed():
                    if rng.random() < fault.probability:
                        link.extra.append((block + 1, malformed(message, rng)))
        if arrives:
            link.under_way.append((due, message))
            link.extra += [(due + later, message) for later in copies]

    def _replayed(self, block: int, sender: str, receiver: str) -> list[NeighbourMessage]:
        """Old messages that come again on a link."""
        had = self._links[sender, receiver].had
        replayed = []
        for fault, rng in self._active(block):
            if not (isinstance(fault, Replay) and fault.concerns(sender, receiver)) or not had:
                continue
            if rng.random() >= fault.probability:
                continue
            choice = had
            if fault.source == "former incarnation":
                choice = [message for message in had if message.incarnation < had[-1].incarnation]
            if not choice:
                continue
            message = choice[rng.integers(len(choice))]
            if fault.source == "other run":
                self.refused += is_refused_in_another_run(message)
            else:
                replayed.append(message)
        return replayed


def _take(timed: _Timed, block: int) -> list[NeighbourMessage]:
    """Take out what is due until a block."""
    due = [message for time, message in timed if time <= block]
    timed[:] = [(time, message) for time, message in timed if time > block]
    return due
