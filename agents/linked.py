"""Agents of a team in one process, with a simulated network."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from coheft.agents.agent import Agent, Outbox
from coheft.estimation.measurement import MeasurementBlock
from coheft.wire.config import AgentConfig
from coheft.wire.messages.size import LARGEST
from coheft.wire.messages.structs import NeighbourMessage


class LinkedAgents:
    """Agents that hear, before each block, what their neighbours said after the block before.

    Args:
        configs: Of all agents.
        incarnation: Larger than that of any agents of the same names before.
        largest_arrays: What an estimator of the user's own may send in one message [B].

    Attributes:
        agents: By robot.
        outboxes: What each agent sent after the last block.
    """

    def __init__(self, configs: Iterable[AgentConfig], incarnation: int = 0, largest_arrays: int = LARGEST) -> None:
        self.agents = {config.name: Agent(config, incarnation, largest_arrays) for config in configs}
        self.outboxes: dict[str, Outbox] = {}

    def heard(self) -> dict[str, list[NeighbourMessage]]:
        """What every robot's neighbours said after the last block."""
        return {
            name: [self.outboxes[other].message for other in agent.config.neighbours if other in self.outboxes]
            for name, agent in self.agents.items()
        }

    def step(
        self,
        index: int,
        blocks: Mapping[str, MeasurementBlock | None],
        heard: Mapping[str, Sequence[NeighbourMessage]],
    ) -> dict[str, Outbox]:
        """Let all agents step, each with its own measurements and what it has heard; what they send."""
        self.outboxes = {name: agent.step(index, blocks[name], heard[name]) for name, agent in self.agents.items()}
        return self.outboxes
