"""An agent that, in place of an estimator, runs dynamic consensus on numbers that the test knows.

All else is the real thing: process, links, gossip. What it is told is in ``$HEARD_FOLDER/inputs.json``; it writes
``<name>.<incarnation>.jsonl`` there, a line per block: what has left, in its own frame.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from coheft.agents import agent as core
from coheft.agents.estimator import Belief, Channels
from coheft.agents.process import main as process
from coheft.consensus import DynamicConsensus, NeighbourStages, metropolis_weight
from coheft.consensus.gossip import Gossip
from coheft.estimation.geometry.spatial import Array, Pose, rotation_exp
from coheft.estimation.measurement import MeasurementBlock
from coheft.wire.config import AgentConfig, AgentProcessConfig
from coheft.wire.process.supervised import supervised_main


class Inputs(msgspec.Struct):
    """What agents are told by the test.

    Attributes:
        rounds: Per block.
        frames: Twist of each robot's frame in the common one, (6,).
        values: Each robot's wrench in the common frame, (6,), and what is added to it from ``changed_at`` on.
        changed_at: A block.
        swing: Blocks in which a sine goes round that multiplies it; 0 if inputs stay.
    """

    rounds: int
    frames: dict[str, list[float]]
    values: dict[str, list[float]]
    changes: dict[str, list[float]] = {}
    changed_at: int = 0
    swing: int = 0

    def to_common(self, name: str) -> Array:
        """What carries a robot's wrenches to the common frame."""
        twist = np.array(self.frames[name])
        return Pose(rotation_exp(twist[:3]), twist[3:]).adjoint()

    def wrench(self, name: str, block: int) -> Array:
        """In the common frame, shape (6,)."""
        wrench = np.array(self.values[name])
        if name in self.changes and block >= self.changed_at:
            wrench += self.changes[name]
        phase = 2.0 * np.pi * block / self.swing + wrench[0] if self.swing else 0.5 * np.pi
        values: Array = wrench * np.sin(phase)
        return values


class ConsensusEstimator:
    """Begins when the team has agreed upon a block, and anew after a loss or when the team changes."""

    def __init__(self, config: AgentConfig, gossip: Gossip) -> None:
        folder = Path(os.environ["HEARD_FOLDER"])
        self._inputs = msgspec.json.decode((folder / "inputs.json").read_bytes(), type=Inputs)
        self._name, self._gossip = config.name, gossip
        self._log = (folder / f"{config.name}.{gossip.own.incarnation}.jsonl").open("w")
        self._start: tuple[int, int] | None = None
        self._dynamic: DynamicConsensus | None = None

    def step(self, index: int, own: MeasurementBlock | None, inbox: Mapping[str, Channels]) -> dict[str, Array]:
        graph, start = self._gossip.graph, self._gossip.start_block
        if graph is None or self._name not in graph:
            return {}
        if not self._gossip.is_ready or (self._dynamic is not None and self._dynamic.is_broken and start == self.begun):
            self._gossip.announce_ready(index + 2 * len(graph))
            start = self._gossip.start_block
        if start is None or index <= start:
            return {}
        if self._start != (self._gossip.membership, start):
            self._start = (self._gossip.membership, start)
            self._dynamic = DynamicConsensus(self._inputs.rounds, 1, 6)
        assert self._dynamic is not None
        own_axes = np.linalg.inv(self._inputs.to_common(self._name))
        heard = [
            NeighbourStages(
                own_axes @ self._inputs.to_common(other),
                np.full(self._inputs.rounds, metropolis_weight(len(graph[self._name]), len(graph[other]))),
                inbox.get(other, {}).get("stages"),
                None if "valid" not in inbox.get(other, {}) else inbox[other]["valid"] > 0.5,
            )
            for other in graph[self._name]
        ]
        finished = self._dynamic.step((own_axes @ self._inputs.wrench(self._name, index))[None], heard)
        stages, valid = self._dynamic.pipeline.sent()
        line = {
            "block": index,
            "members": len(graph),
            "start": start,
            "finished": None if finished is None else finished[0].tolist(),
        }
        self._log.write(json.dumps(line) + "\n")
        self._log.flush()
        return {"stages": stages, "valid": valid.astype(np.float64)}

    @property
    def begun(self) -> int | None:
        """The block after which its sums have begun."""
        return None if self._start is None else self._start[1]

    def fits(self, channels: Channels) -> bool:
        stages, valid = channels.get("stages"), channels.get("valid")
        rounds = self._inputs.rounds
        return (stages is None or stages.shape == (rounds, 1, 6)) and (valid is None or valid.shape == (rounds,))

    def belief(self) -> Belief:
        return Belief("poses", False, None, {})

    def doubts(self) -> tuple[str, ...]:
        return ()


def run(config: AgentProcessConfig) -> None:
    estimators: dict[str, Any] = core.ESTIMATORS
    estimators["fan2017"] = ConsensusEstimator
    process.run_agent(config)


if __name__ == "__main__":
    supervised_main(AgentProcessConfig, run)
