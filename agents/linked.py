"""Agents of a team in one process, linked by a simulated network."""

from collections.abc import Iterable, Mapping, Sequence

from coheft.agents.agent import Agent, Outbox
from coheft.estimation.measurement import MeasurementBlock
from coheft.wire.config import AgentConfig
from coheft.wire.messages.size import LARGEST
from coheft.wire.messages.structs import NeighbourMessage


class LinkedAgents:
    """Agents that receive, before each block, the messages that their neighbours sent after the previous block.

    Arguments are those of ``Agent``, with the configurations of all agents.

    Attributes:
        agents: The agents, by robot.
        outboxes: What each agent sent after the last block, by robot.
    """

    def __init__(self, configs: Iterable[AgentConfig], incarnation: int = 0, largest_arrays: int = LARGEST) -> None:
        self.agents = {config.name: Agent(config, incarnation, largest_arrays) for config in configs}
        self.outboxes: dict[str, Outbox] = {}

    def received(self) -> dict[str, list[NeighbourMessage]]:
        """Return the messages that each robot's neighbours sent after the last block, by receiving robot."""
        return {
            name: [self.outboxes[other].message for other in agent.config.neighbours if other in self.outboxes]
            for name, agent in self.agents.items()
        }

    def step(
        self,
        index: int,
        blocks: Mapping[str, MeasurementBlock | None],
        received: Mapping[str, Sequence[NeighbourMessage]],
    ) -> dict[str, Outbox]:
        """Step all agents, each with its own measurements and received messages; return what they send."""
        self.outboxes = {name: agent.step(index, blocks[name], received[name]) for name, agent in self.agents.items()}
        return self.outboxes
