"""Runs a simulation and its agents through a schedule, block by block."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass

from coheft.agents.agent import Agent, Outbox
from coheft.app.faults.grasp_schedule import GraspSchedule
from coheft.app.faults.network import Network
from coheft.app.faults.readings import Readings
from coheft.app.faults.schedule import Crash, FaultSchedule, Pause, RobotFault
from coheft.consensus.graph import build_graph
from coheft.estimation.measurement import MeasurementBlock
from coheft.physics_server.simulation import Simulation
from coheft.wire.config import agent_config
from coheft.wire.messages.structs import Reference
from coheft.wire.messages.truth import Truth


@dataclass(frozen=True, eq=False)
class FaultyBlock:
    """One block of a run: messages of all agents that are running, and exceptions that agents raised, by name."""

    block: int
    truth: Truth
    outboxes: dict[str, Outbox]
    crashes: dict[str, Exception]


class FaultyRun:
    """A team with its load and its faults.

    An agent that raises an exception is dead from then on, as its process would be.
    """

    def __init__(self, schedule: FaultSchedule) -> None:
        scenario = schedule.scenario
        self.graph = build_graph(scenario.graph, scenario.robot_names)
        self.network = Network(schedule, self.graph)
        self.next_block = 0
        self._schedule = schedule
        self._simulation = Simulation(scenario, self.graph)
        self.scene = self._simulation.scene
        self._readings = {name: Readings(schedule, name) for name in self.graph}
        self._grasps = {name: GraspSchedule(schedule, name) for name in self.graph}
        self._incarnations = dict.fromkeys(self.graph, 0)
        self._agents: dict[str, Agent | None] = {name: self._make_agent(name) for name in self.graph}
        self._raised: set[str] = set()
        self._references: dict[int, dict[str, Reference]] = {}

    def __iter__(self) -> Iterator[FaultyBlock]:
        """Yield all remaining blocks of the run, or raise a ``SimulationError`` when robots have lost the payload."""
        while self.next_block < self._schedule.scenario.blocks:
            yield self._advance()

    def without_harmless(self) -> FaultyRun:
        """Return a copy of the run from here on, without harmless messages, see ``schedule.is_harmless``."""
        quiet = copy.deepcopy(self)
        quiet.network.harmless = False
        return quiet

    def _advance(self) -> FaultyBlock:
        block = self.next_block
        self.next_block += 1
        time = block * self._schedule.scenario.block_duration
        self._crash_and_restart(block, time)
        self._grasp_and_release(block)
        result = self._simulation.advance(self._references.pop(block, {}))
        samples = {name: self._readings[name].read(block, m.samples) for name, m in result.measurements.items()}
        outboxes: dict[str, Outbox] = {}
        crashes: dict[str, Exception] = {}
        for name, agent in self._agents.items():
            if agent is None or self._is_hit(Pause, name, time):
                continue
            try:
                for notice in self._grasps[name].due(block):
                    agent.set_holding(notice.holding, notice.from_block)
                outboxes[name] = agent.step(
                    block, MeasurementBlock(block, samples[name]), self.network.collect(block, name)
                )
            except Exception as error:  # any exception breaks a promise
                crashes[name] = error
        self._raised |= set(crashes)
        for outbox in outboxes.values():
            self.network.post(block, outbox.message)
            self._references.setdefault(outbox.reference.block, {})[outbox.reference.robot] = outbox.reference
        return FaultyBlock(block, result.truth, outboxes, crashes)

    def _make_agent(self, name: str) -> Agent:
        config = agent_config(self._schedule.scenario, name, self.graph[name])
        return Agent(config, self._incarnations[name])

    def _crash_and_restart(self, block: int, time: float) -> None:
        for name, agent in self._agents.items():
            if name in self._raised or self._is_hit(Crash, name, time):
                self._agents[name] = None
            elif agent is None:
                self._incarnations[name] += 1
                self.network.forget(block, name)
                self._grasps[name].restart(block)
                self._agents[name] = self._make_agent(name)

    def _grasp_and_release(self, block: int) -> None:
        for name, grasp in self._grasps.items():
            if grasp.holds(block) != (grasp.holds(block - 1) if block else True):
                (self._simulation.grasp if grasp.holds(block) else self._simulation.release)(name)

    def _is_hit(self, kind: type[RobotFault], robot: str, time: float) -> bool:
        faults = self._schedule.faults
        return any(isinstance(f, kind) and f.robot == robot and f.is_active(time) for f in faults)
