"""One pusher's part in the sums of all pushers' wrenches and measurements over the network.

All values are in the frames of the cart and the floor, which every robot knows, so no transforms are needed.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coheft.consensus.gossip import Gossip
from coheft.consensus.graph import flood_delay
from coheft.consensus.pipeline import NeighbourStages, Pipeline
from coheft.consensus.schedule import choose_schedule
from coheft.estimation.geometry.spatial import Array
from coheft.wire.cart.messages import CartMessage

_WRENCH, _LEVERAGE, _MOTION = slice(0, 3), slice(3, 12), slice(12, 18)
CHANNELS = 18
_LARGEST = 1e6
"""Limit of every total, in its unit."""
_LEAST_LEVERAGE = 1e-6
"""Smallest possible leverage of all hands together, in any direction."""


@dataclass(frozen=True, eq=False)
class Totals:
    """Sums over all pushers at one sample.

    Attributes:
        wrench_b: Total wrench of the hands from this sample to the next, as measured, shape (3,).
        leverage: Total leverage of the hands, see ``coheft.estimation.cart.contact``, shape (3, 3).
        motion: Mean of all measurements of ``(q, qd)``, shape (6,).
    """

    block: int
    members: int
    wrench_b: Array
    leverage: Array
    motion: Array


@dataclass(frozen=True, eq=False)
class Lost:
    """A sample whose totals were lost."""

    block: int


class CartSums:
    """One pusher's part in the sums."""

    def __init__(self, name: str, gossip: Gossip) -> None:
        self._name = name
        self._gossip = gossip
        self._announced = False
        self._pipeline: Pipeline | None = None
        self._start = 0
        self._scale = 1.0
        self._members = 1
        self._own_gains = np.ones(0)
        self._gains: dict[str, Array] = {}

    def step(
        self, index: int, wrench_b: Array, leverage: Array, motion: Array, inbox: Sequence[CartMessage]
    ) -> Totals | Lost | None:
        """Enter one sample, and return the totals of an earlier one, or that they are lost; None before the first
        result.

        A sample consists of this pusher's wrench from then on, shape (3,), the leverage of its hand, shape (3, 3), and
        its measurement of ``(q, qd)``, shape (6,). The inbox has the neighbours' messages of the previous sample.
        """
        values = np.concatenate([wrench_b, leverage.ravel(), motion])
        if not self._gossip.own.neighbours:
            return _totals(index, 1, values)
        self._prepare(index)
        if self._pipeline is None or index < self._start:
            return None
        finished = self._pipeline.advance(self._stages(inbox), self._own_gains)
        self._pipeline.enter(values[None])
        leaving = index - self._pipeline.rounds
        if leaving < self._start:
            return None
        totals = None if finished is None else _totals(leaving, self._members, self._scale * finished[0])
        return totals if totals is not None and _are_possible(totals) else Lost(leaving)

    @property
    def stages(self) -> Array:
        """Values to send to the neighbours, shape (K, 1, C)."""
        return np.zeros((0, 1, CHANNELS)) if self._pipeline is None else self._pipeline.stages.copy()

    @property
    def valid(self) -> Array:
        """Whether each of the values to send is complete, shape (K,)."""
        return np.zeros(0) if self._pipeline is None else self._pipeline.valid.astype(np.float64)

    def _prepare(self, index: int) -> None:
        """Once the graph is known, agree on the sample at which the sums begin, and prepare for it."""
        graph = self._gossip.graph
        if graph is None or self._pipeline is not None:
            return
        if not self._announced:
            # At that block the most distant robot has received this announcement.
            self._gossip.announce_ready(index + flood_delay(graph))
            self._announced = True
        start = self._gossip.start_block
        if start is None:
            return
        schedule = choose_schedule(graph)
        self._start = start
        self._scale = schedule.scale
        self._members = len(graph)
        self._own_gains = schedule.gains(self._name, self._name)
        self._gains = {other: schedule.gains(self._name, other) for other in graph[self._name]}
        self._pipeline = Pipeline(schedule.rounds, 1, CHANNELS)

    def _stages(self, inbox: Sequence[CartMessage]) -> list[NeighbourStages]:
        received = {message.sender: (message.stages, message.valid > 0.5) for message in inbox}
        return [
            NeighbourStages(None, gains, *received.get(other, (None, None))) for other, gains in self._gains.items()
        ]


def _totals(block: int, members: int, sums: Array) -> Totals:
    return Totals(block, members, sums[_WRENCH], sums[_LEVERAGE].reshape(3, 3), sums[_MOTION] / members)


def _are_possible(totals: Totals) -> bool:
    """Whether the totals are plausible; a faulty message may have corrupted them."""
    size = max(np.abs(each).max() for each in (totals.wrench_b, totals.leverage, totals.motion))
    return bool(size < _LARGEST and np.linalg.eigvalsh(totals.leverage)[0] > _LEAST_LEVERAGE)
