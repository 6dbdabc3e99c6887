"""The data of the network that one robot needs for its sums: weights of its edges, and properties of all weights."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from math import ceil, log

import numpy as np

from coheft.agents.estimator import Channels
from coheft.consensus.dynamic import Extrapolation
from coheft.consensus.graph import Neighbours, convergence_rate, metropolis_weight, uniform_weight, weight_matrix
from coheft.consensus.pipeline import NeighbourStages
from coheft.estimation.geometry.spatial import Array
from coheft.wire.config import AgentConfig

_LEFT = 2e-3
"""Sums are used once the initial disagreement has shrunk to this share."""
_WORTH = 0.15
"""Sums are extrapolated if no larger share of their lag is left then: its size is known, but not its sign."""
_MOST_LEFT = 0.25
"""The lag is unknown if extrapolation leaves a larger share of it, and rounds a larger share of the disagreement."""


@dataclass(frozen=True)
class Network:
    """The team as a robot sees it.

    Attributes:
        members: How many there are.
        gains: Weights of its edges, by neighbour.
        rate: What a round leaves of the disagreement, see ``convergence_rate``.
        extrapolation: Of sums that have gone through all rounds.
        knows_lag: Whether the last round shows how far these lag behind: after few rounds several eigenvectors of the
            weights share the disagreement, and what it changes may cancel out while much is left.
    """

    members: int
    gains: Mapping[str, float]
    rate: float
    extrapolation: Extrapolation
    knows_lag: bool

    @staticmethod
    def of(config: AgentConfig, graph: Neighbours) -> Network:
        """Make it for the robot with this configuration."""
        settings = config.fan2017
        gain = _gain(graph, settings.consensus_weights)
        gains = {name: gain(config.name, name) for name in graph[config.name]}
        edges = tuple(sorted((name, *others) for name, others in graph.items()))
        rate, extrapolation = _convergence(edges, settings.consensus_weights, settings.rounds)
        knows_lag = extrapolation.share < _MOST_LEFT or rate**settings.rounds < _MOST_LEFT
        if not settings.extrapolate or extrapolation.share > _WORTH:
            extrapolation = Extrapolation(0.0, rate / (1.0 - rate), 1.0)  # if only the slowest part is left
        return Network(len(graph), gains, rate, extrapolation, knows_lag)

    @property
    def mixing_rounds(self) -> int:
        """After how many rounds the initial disagreement has shrunk so far that sums are used."""
        return ceil(log(_LEFT) / log(max(self.rate, 1e-9)))

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


def _gain(graph: Neighbours, weights: str) -> Callable[[str, str], float]:
    """What gives an edge its weight."""
    if weights == "uniform":
        equal = uniform_weight(graph)
        return lambda one, other: equal
    return lambda one, other: metropolis_weight(len(graph[one]), len(graph[other]))


@lru_cache(maxsize=16)
def _convergence(edges: tuple[tuple[str, ...], ...], weights: str, rounds: int) -> tuple[float, Extrapolation]:
    """Rate and extrapolation, once for all robots of a large team that share a process."""
    graph = {each[0]: each[1:] for each in edges}
    matrix = weight_matrix(graph, _gain(graph, weights))
    return convergence_rate(matrix), Extrapolation.of(matrix, rounds)


@cache
def _in_all_rounds(gain: float, rounds: int) -> Array:
    """The gain of each round, shape (rounds,); not to be changed, because others get the same array."""
    result = np.full(rounds, gain)
    result.flags.writeable = False
    return result
