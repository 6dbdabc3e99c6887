"""The data of the network that one robot needs for its sums: weights of its edges, and properties of all weights."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from coheft.agents.estimator import Channels
from coheft.consensus.graph import (
    Neighbours,
    convergence_rate,
    diameter,
    metropolis_weight,
    uniform_weight,
    weight_matrix,
)
from coheft.consensus.pipeline import NeighbourStages
from coheft.estimation.geometry.spatial import Array
from coheft.wire.config import AgentConfig
from coheft.wire.messages.size import MANY


@dataclass(frozen=True)
class Network:
    """The team as a robot sees it.

    Attributes:
        members: How many there are.
        gains: Weights of its edges, by neighbour.
        rate: What a round leaves of the disagreement, see ``convergence_rate``.
    """

    members: int
    gains: Mapping[str, float]
    rate: float

    @staticmethod
    def of(config: AgentConfig, graph: Neighbours) -> Network:
        """In a team of more than ``MANY`` the rate is a bound: no robot decomposes as large a matrix."""
        equal = uniform_weight(graph) if config.fan2017.consensus_weights == "uniform" else None

        def gain(one: str, other: str) -> float:
            return metropolis_weight(len(graph[one]), len(graph[other])) if equal is None else equal

        gains = {name: gain(config.name, name) for name in graph[config.name]}
        if len(graph) > MANY:
            # The second smallest eigenvalue of a Laplacian is 4 / (N diameter) at least (Mohar 1991), and the smallest
            # weight that of a uniform one.
            rate = 1.0 - 4.0 * uniform_weight(graph) / (len(graph) * diameter(graph))
            return Network(len(graph), gains, rate)
        return Network(len(graph), gains, convergence_rate(weight_matrix(graph, gain)))

    @property
    def left_by_a_round(self) -> float:
        """So much disagreement is left at most, for what the last round did of it."""
        return self.rate / (1.0 - self.rate)

    def stages(
        self, channel: str, transports: Mapping[str, Array], inbox: Mapping[str, Channels], rounds: int
    ) -> list[NeighbourStages]:
        """The neighbours' stages of a consensus.

        Args:
            channel: Its name.
            transports: ``X_ij`` by neighbour.
            inbox: What the neighbours sent.
            rounds: Rounds that each value goes through.
        """
        stages = []
        for name, transport in transports.items():
            channels = inbox.get(name, {})
            valid = channels.get(f"{channel}_valid")
            stages.append(
                NeighbourStages(
                    transport=transport,
                    gains=_in_all_rounds(self.gains[name], rounds),
                    stages=channels.get(channel),
                    valid=None if valid is None else valid > 0.5,
                )
            )
        return stages


@cache
def _in_all_rounds(gain: float, rounds: int) -> Array:
    """The gain of each round, shape (rounds,); not to be changed, because others get the same array."""
    result = np.full(rounds, gain)
    result.flags.writeable = False
    return result
