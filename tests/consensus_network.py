"""Agents on a graph whose neighbours hear each other's stages, each agent in a random frame of its own."""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np

from coheft.consensus.dynamic import DynamicConsensus
from coheft.consensus.graph import Neighbours, metropolis_weight
from coheft.consensus.pipeline import NeighbourStages, Pipeline
from coheft.estimation.geometry.spatial import Array, Pose, rotation_exp

SAMPLES = 3
CHANNELS = 6


class Network:
    """Wrenches under way between agents.

    Args:
        graph: Who hears whom.
        rounds: Rounds per value.
        seed: Of the frames.

    Attributes:
        to_common: What carries each agent's wrenches to the common frame, by name.
    """

    def __init__(self, graph: Neighbours, rounds: int, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        poses = {name: Pose(rotation_exp(rng.normal(size=3)), rng.normal(size=3)) for name in graph}
        self.graph = graph
        self.rounds = rounds
        self.to_common = {name: pose.adjoint() for name, pose in poses.items()}
        self.transports = {
            (i, j): (poses[i].inverse() @ poses[j]).adjoint() for i, others in graph.items() for j in others
        }
        self.dynamic = {name: DynamicConsensus(rounds, SAMPLES, CHANNELS) for name in graph}

    def gain(self, i: str, j: str) -> float:
        return metropolis_weight(len(self.graph[i]), len(self.graph[j]))

    def own_gains(self, i: str) -> Array:
        return np.full(self.rounds, 1.0 - sum(self.gain(i, j) for j in self.graph[i]))

    def heard(
        self, pipelines: dict[str, Pipeline], lost: Collection[tuple[str, str]] = ()
    ) -> dict[str, list[NeighbourStages]]:
        """What everyone hears now; messages (to, from) in ``lost`` do not arrive."""
        sent = {name: pipeline.sent() for name, pipeline in pipelines.items()}
        return {
            i: [
                NeighbourStages(
                    self.transports[i, j],
                    np.full(self.rounds, self.gain(i, j)),
                    *((None, None) if (i, j) in lost else sent[j]),
                )
                for j in others
            ]
            for i, others in self.graph.items()
        }

    def step(self, inputs: dict[str, Array], lost: Collection[tuple[str, str]] = ()) -> dict[str, Array | None]:
        """One block of dynamic consensus."""
        heard = self.heard({name: agent.pipeline for name, agent in self.dynamic.items()}, lost)
        return {name: agent.step(inputs[name], heard[name]) for name, agent in self.dynamic.items()}

    def in_common(self, values: Callable[[str], Array]) -> Array:
        """Everyone's values in the common frame, shape (N, ..., C)."""
        return np.array([values(name) @ self.to_common[name].T for name in self.graph])

    def random_inputs(self, rng: np.random.Generator) -> dict[str, Array]:
        return {name: rng.normal(size=(SAMPLES, CHANNELS)) for name in self.graph}
