"""Agents in one process, block by block, with or without physics: what benchmarks time and record."""

from __future__ import annotations

import time
from collections.abc import Mapping

from agents.agent import Agent, Outbox
from coheft.errors import CoheftError
from coheft.estimation.measurement import MeasurementBlock
from coheft.wire.config import agent_config
from coheft.wire.messages import NeighbourMessage, Reference, Truth
from coheft.wire.scenario import Scenario
from consensus.graph import build_graph
from physics_server.simulation import Simulation


class Network:
    """A team and its physics in this process; time is counted separately for both.

    Attributes:
        block_duration: Of one block [s].
        graph: Who talks with whom.
        outboxes: What each agent said last.
        truth: The newest block's; None before the first.
        agents_time: CPU time of all agents so far [s].
        physics_time: CPU time of physics and sensors so far [s].
    """

    def __init__(self, scenario: Scenario) -> None:
        self.block_duration = scenario.block_duration
        self._lookahead = scenario.lookahead
        self.graph = build_graph(scenario.graph, scenario.robot_names)
        self._agents = {name: Agent(agent_config(scenario, name, self.graph[name])) for name in self.graph}
        self._simulation = Simulation(scenario, self.graph)
        self._references: dict[int, dict[str, Reference]] = {}
        self._messages: Mapping[str, NeighbourMessage] = {}
        self.scene = self._simulation.scene
        self.outboxes: dict[str, Outbox] = {}
        self.truth: Truth | None = None
        self.agents_time = self.physics_time = 0.0
        self._phases: dict[str, str] = {}

    @property
    def block(self) -> int:
        """Number of blocks so far."""
        return self._simulation.block

    def settle(self, time: float) -> None:
        """Run until that time [s].

        Raises:
            CoheftError: Not every agent weighs the load then: it is no team like those that are measured.
        """
        self.run_until(time)
        if not self.is_working:
            raise CoheftError(f"after {time:g} s not every agent weighs the load: what would be measured is a start")

    @property
    def is_working(self) -> bool:
        """Whether every agent weighs the load."""
        return len(self._phases) == len(self._agents) and set(self._phases.values()) == {"inertia"}

    def step(self) -> None:
        """One block."""
        block = self.block
        began = time.process_time()
        result = self._simulation.advance(self._references.pop(block, {}))
        self.truth = result.truth
        measured = {name: MeasurementBlock(block, each.samples) for name, each in result.measurements.items()}
        between = time.process_time()
        self.outboxes = {
            name: agent.step(
                block, measured[name], [self._messages[other] for other in self.graph[name] if other in self._messages]
            )
            for name, agent in self._agents.items()
        }
        ended = time.process_time()
        self.physics_time += between - began
        self.agents_time += ended - between
        self._messages = {name: outbox.message for name, outbox in self.outboxes.items()}
        self._references[block + self._lookahead] = {name: outbox.reference for name, outbox in self.outboxes.items()}
        for name, outbox in self.outboxes.items():
            if outbox.estimate is not None:
                self._phases[name] = outbox.estimate.phase

    def run_until(self, seconds: float) -> None:
        """All blocks up to a simulated time [s]."""
        while self.block * self.block_duration < seconds:
            self.step()
