"""A whole run in one process: the same physics and agents, with a simulated network.

It gives the same numbers as ``coheft run`` in lockstep, bit for bit, without processes and sockets.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from coheft.agents.agent import Agent, Outbox
from coheft.agents.linked import LinkedAgents
from coheft.consensus.graph import build_graph
from coheft.estimation.measurement import MeasurementBlock
from coheft.physics_server.simulation import BlockResult, Simulation
from coheft.wire.config import agent_config
from coheft.wire.messages.size import largest_arrays
from coheft.wire.messages.structs import Estimate, NeighbourMessage, Reference
from coheft.wire.messages.truth import Truth
from coheft.wire.scenario.schema import Scenario


class TeamInProcess:
    """All parts of a run. For each block, call ``measure``, then ``answer`` with what is ``measured`` and ``heard``."""

    def __init__(self, scenario: Scenario) -> None:
        self.graph = build_graph(scenario.graph, scenario.robot_names)
        self.simulation = Simulation(scenario, self.graph)
        self.start_agents(scenario)
        self._lookahead = scenario.lookahead
        self._references: dict[int, dict[str, Reference]] = {}

    def start_agents(self, scenario: Scenario, incarnation: int = 0) -> None:
        """Replace the agents by new ones with an empty memory; ``incarnation`` is larger than theirs."""
        configs = [agent_config(scenario, name, others) for name, others in self.graph.items()]
        self._linked = LinkedAgents(configs, incarnation, largest_arrays(scenario))

    @property
    def agents(self) -> dict[str, Agent]:
        """The agents, by robot."""
        return self._linked.agents

    def measure(self) -> BlockResult:
        """Simulate a block with the agents' references."""
        return self.simulation.advance(self._references.pop(self.simulation.block, {}))

    def received(self) -> dict[str, list[NeighbourMessage]]:
        """Return the messages that each robot's neighbours sent after the last block, by receiving robot."""
        return self._linked.received()

    def answer(
        self,
        blocks: Mapping[str, MeasurementBlock | None],
        heard: Mapping[str, Sequence[NeighbourMessage]],
    ) -> dict[str, Outbox]:
        """Step all agents, each with its own measurements and received messages; return what they send."""
        index = self.simulation.block - 1
        outboxes = self._linked.step(index, blocks, heard)
        references = {name: outbox.reference for name, outbox in outboxes.items()}
        self._references[index + self._lookahead] = references
        return outboxes


def measured(result: BlockResult) -> dict[str, MeasurementBlock | None]:
    """Return a block's measurements by robot, in the agents' form."""
    return {name: MeasurementBlock(each.block, each.samples) for name, each in result.measurements.items()}


@dataclass(frozen=True, eq=False)
class BlockRecord:
    """One block of a run: the truth, and the estimates that were reported after it."""

    truth: Truth
    estimates: dict[str, Estimate]


def run_in_process(scenario: Scenario) -> Iterator[BlockRecord]:
    """Run a scenario, and yield a record of each block."""
    team = TeamInProcess(scenario)
    for _ in range(scenario.blocks):
        result = team.measure()
        outboxes = team.answer(measured(result), team.received())
        yield BlockRecord(
            result.truth, {name: out.estimate for name, out in outboxes.items() if out.estimate is not None}
        )
