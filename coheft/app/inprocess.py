"""A whole run in one process: the same physics, the same agents, and a network that is a dictionary.

Gives the same numbers as ``coheft run`` in lockstep, bit for bit, without processes and sockets.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from agents.agent import Agent
from coheft.estimation.measurement import MeasurementBlock
from coheft.wire.config import agent_config
from coheft.wire.messages import Estimate, NeighbourMessage, Reference, Truth
from coheft.wire.scenario import Scenario
from consensus.graph import build_graph
from physics_server.simulation import Simulation


@dataclass(frozen=True, eq=False)
class BlockRecord:
    """One block of a run: the truth, and the estimates that were reported after it."""

    truth: Truth
    estimates: dict[str, Estimate]


def run_in_process(scenario: Scenario) -> Iterator[BlockRecord]:
    """Run a scenario block by block."""
    graph = build_graph(scenario.graph, scenario.robot_names)
    agents = {name: Agent(agent_config(scenario, name, graph[name])) for name in graph}
    simulation = Simulation(scenario)
    references: dict[int, dict[str, Reference]] = {}
    messages: dict[str, NeighbourMessage] = {}
    for block in range(scenario.blocks):
        result = simulation.advance(references.pop(block, {}))
        outboxes = {}
        for name, agent in agents.items():
            inbox = [messages[other] for other in graph[name] if other in messages]
            measured = MeasurementBlock(block, result.measurements[name].samples)
            outboxes[name] = agent.step(block, measured, inbox)
        messages = {name: outbox.message for name, outbox in outboxes.items()}
        references[block + scenario.lookahead] = {name: outbox.reference for name, outbox in outboxes.items()}
        yield BlockRecord(
            result.truth, {name: out.estimate for name, out in outboxes.items() if out.estimate is not None}
        )
