"""A whole run in one process: the same physics, the same agents, and a network that is a dictionary.

Gives the same numbers as ``coheft run`` in lockstep, bit for bit, without processes and sockets.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from coheft.agents.agent import Agent, Outbox
from coheft.consensus.graph import build_graph
from coheft.estimation.measurement import MeasurementBlock
from coheft.physics_server.simulation import BlockResult, Simulation
from coheft.wire.config import agent_config
from coheft.wire.messages.size import largest_arrays
from coheft.wire.messages.structs import Estimate, NeighbourMessage, Reference, Truth
from coheft.wire.scenario.schema import Scenario


class TeamInProcess:
    """All parts of a run. A block is ``measure``, then ``answer`` to what is ``measured`` and ``heard``.

    Args:
        scenario: What to run.

    Attributes:
        graph: Neighbours of every robot.
        simulation: The physics.
        agents: By robot.
        outboxes: What each agent sent after the last block.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.graph = build_graph(scenario.graph, scenario.robot_names)
        self.simulation = Simulation(scenario, self.graph)
        self.start_agents(scenario)
        self._lookahead = scenario.lookahead
        self._references: dict[int, dict[str, Reference]] = {}

    def start_agents(self, scenario: Scenario, incarnation: int = 0) -> None:
        """Let agents that know nothing take the place of those that there are.

        Args:
            scenario: What they are told to do.
            incarnation: Larger than that of those before.
        """
        largest = largest_arrays(scenario)
        self.agents = {
            name: Agent(agent_config(scenario, name, others), incarnation, largest)
            for name, others in self.graph.items()
        }
        self.outboxes: dict[str, Outbox] = {}

    def measure(self) -> BlockResult:
        """Let the physics go on by a block, with the arms as the agents wanted them."""
        return self.simulation.advance(self._references.pop(self.simulation.block, {}))

    def heard(self) -> dict[str, list[NeighbourMessage]]:
        """What every robot's neighbours said after the last block."""
        return {
            name: [self.outboxes[other].message for other in others if other in self.outboxes]
            for name, others in self.graph.items()
        }

    def answer(
        self,
        blocks: Mapping[str, MeasurementBlock | None],
        heard: Mapping[str, Sequence[NeighbourMessage]],
    ) -> dict[str, Outbox]:
        """Let all agents step, each with its own measurements and what it has heard; what they send."""
        index = self.simulation.block - 1
        self.outboxes = {name: agent.step(index, blocks[name], heard[name]) for name, agent in self.agents.items()}
        references = {name: outbox.reference for name, outbox in self.outboxes.items()}
        self._references[index + self._lookahead] = references
        return self.outboxes


def measured(result: BlockResult) -> dict[str, MeasurementBlock | None]:
    """A block as every robot has measured it."""
    return {name: MeasurementBlock(each.block, each.samples) for name, each in result.measurements.items()}


@dataclass(frozen=True, eq=False)
class BlockRecord:
    """One block of a run: the truth, and the estimates that were reported after it."""

    truth: Truth
    estimates: dict[str, Estimate]


def run_in_process(scenario: Scenario) -> Iterator[BlockRecord]:
    """Run a scenario block by block."""
    team = TeamInProcess(scenario)
    for _ in range(scenario.blocks):
        result = team.measure()
        outboxes = team.answer(measured(result), team.heard())
        yield BlockRecord(
            result.truth, {name: out.estimate for name, out in outboxes.items() if out.estimate is not None}
        )
