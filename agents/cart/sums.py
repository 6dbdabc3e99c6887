"""Sums of the pushes and measurements of all cart pushers over the network: one pusher's part.

All values are in frames that every robot knows, the cart's and the floor's, so nothing has to be transformed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coheft.consensus.gossip import Gossip
from coheft.consensus.graph import hearing
from coheft.consensus.pipeline import NeighbourStages, Pipeline
from coheft.consensus.schedule import choose_schedule
from coheft.estimation.geometry.spatial import Array
from coheft.wire.cart.messages import CartMessage

_WRENCH, _LEVERAGE, _MOTION = slice(0, 3), slice(3, 12), slice(12, 18)
CHANNELS = 18
_LARGEST = 1e6
"""No total is as large as this, in its unit."""
_LEAST_LEVERAGE = 1e-6
"""Nor do all hands together have as little leverage as this in any direction."""


@dataclass(frozen=True, eq=False)
class Totals:
    """Of all pushers, at one sample.

    Attributes:
        block: The sample.
        members: How many pushers there are.
        wrench_b: Of all hands from this sample to the next, as measured, shape (3,).
        leverage: Of all hands, see ``coheft.estimation.cart.contact``, shape (3, 3).
        motion: Mean of all measurements of ``(q, qd)``, shape (6,).
    """

    block: int
    members: int
    wrench_b: Array
    leverage: Array
    motion: Array


@dataclass(frozen=True, eq=False)
class Lost:
    """A sample whose totals were lost.

    Attributes:
        block: The sample.
    """

    block: int


class CartSums:
    """One pusher's part in the sums.

    Args:
        name: Its name.
        gossip: Learns who there is.
    """

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
        """One sample enters; one that entered earlier leaves, or was lost; None before the first one leaves.

        Args:
            index: The sample.
            wrench_b: What the own hand does from then on, shape (3,).
            leverage: Of the own hand, shape (3, 3).
            motion: As the pusher measures it, shape (6,).
            inbox: What the neighbours sent after the sample before.
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
        """What to send to the neighbours, shape (K, 1, C)."""
        return np.zeros((0, 1, CHANNELS)) if self._pipeline is None else self._pipeline.stages.copy()

    @property
    def valid(self) -> Array:
        """Which of it is complete, shape (K,)."""
        return np.zeros(0) if self._pipeline is None else self._pipeline.valid.astype(np.float64)

    def _prepare(self, index: int) -> None:
        """Once the graph is known, agree on the sample at which the sums begin, and get ready for it."""
        graph = self._gossip.graph
        if graph is None or self._pipeline is not None:
            return
        if not self._announced:
            # Until then the farthest has heard that this one is ready, too.
            self._gossip.announce_ready(index + hearing(graph))
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
        heard = {message.sender: message for message in inbox}
        return [
            NeighbourStages(None, gains, message.stages, message.valid > 0.5)
            if (message := heard.get(other)) is not None
            else NeighbourStages(None, gains, None, None)
            for other, gains in self._gains.items()
        ]


def _totals(block: int, members: int, sums: Array) -> Totals:
    return Totals(block, members, sums[_WRENCH], sums[_LEVERAGE].reshape(3, 3), sums[_MOTION] / members)


def _are_possible(totals: Totals) -> bool:
    """Whether no message has made nonsense of them."""
    size = max(np.abs(each).max() for each in (totals.wrench_b, totals.leverage, totals.motion))
    return bool(size < _LARGEST and np.linalg.eigvalsh(totals.leverage)[0] > _LEAST_LEVERAGE)
