"""The simulated network: queues of messages for each agent and block, with all faults of messages."""

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
"""Selects the random stream of the order of messages."""

_Timed = list[tuple[int, NeighbourMessage]]
_Active = list[tuple[AnyFault, np.random.Generator]]


@dataclass(eq=False)
class _Link:
    """Messages from one agent to another: those under way with the block at which they arrive, extra ones that must not
    make any difference, and those that it has had.
    """

    under_way: _Timed = field(default_factory=list)
    extra: _Timed = field(default_factory=list)
    had: list[NeighbourMessage] = field(default_factory=list)


class Network:
    """Transmits messages along the edges of a graph; a message sent after one block arrives before the next.

    The order of the messages of one block is random.

    Attributes:
        harmless: Whether to deliver messages that must not make any difference, see ``schedule.is_harmless``.
        refused: Number of messages that were not delivered because the codec refused them.
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
        """Send an agent's message to all its neighbours after a block."""
        active = self._active(block)
        for fault, rng in active:
            if isinstance(fault, Lie) and fault.robot == message.sender:
                message = lie_about(message, fault, rng)
        for receiver in self._graph[message.sender]:
            self._send(block, message, receiver, active)

    def collect(self, block: int, receiver: str) -> list[NeighbourMessage]:
        """Return all messages that have arrived at an agent until a block, in random order."""
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
        """Drop all messages for an agent that restarts at a block, received and pending copies included.

        To the new agent, copies of earlier messages would be new messages.
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
        """Send one message on one link. Every active fault draws random numbers, so that faults are independent."""
        link = self._links[message.sender, receiver]
        due, arrives = block + 1, True
        copies: list[int] = []
        for fault, rng in active:
            if isinstance(fault, Partition):
                arrives &= (message.sender in fault.group) == (receiver in fault.group)
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
        """Return old messages that arrive again on a link."""
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
    """Remove and return the messages that are due until a block."""
    due = [message for time, message in timed if time <= block]
    timed[:] = [(time, message) for time, message in timed if time > block]
    return due
