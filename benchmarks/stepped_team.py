"""A team of agents and its physics in one process, with separate CPU times: what benchmarks measure and record."""

from __future__ import annotations

import time

from coheft.agents.agent import Outbox
from coheft.app.run.inprocess import TeamInProcess, measured
from coheft.errors import CoheftError
from coheft.wire.scenario.schema import Scenario

SETTLED = 12.0
"""Time after which the cost of a block is that of the rest of the run, because fits have become rare [s]."""
_SETTLED_BLOCKS = 150
"""The same for long blocks: a start takes a number of blocks, however long they are."""
_TURN = 10
"""Number of blocks in a turn."""


class SteppedTeam:
    """A team and its physics.

    Attributes:
        block_duration: Duration of a block [s].
        graph: Neighbours of each robot.
        outboxes: Each agent's latest messages.
        agents: CPU time per agent and block, for each turn [s].
        physics: CPU time of physics and sensors per block, for each turn [s].
    """

    def __init__(self, scenario: Scenario) -> None:
        self.block_duration = scenario.block_duration
        self._team = TeamInProcess(scenario)
        self.graph = self._team.graph
        self.outboxes: dict[str, Outbox] = {}
        self.agents: list[float] = []
        self.physics: list[float] = []
        self._phases: dict[str, str] = {}

    @property
    def block(self) -> int:
        """Number of blocks so far."""
        return self._team.simulation.block

    @property
    def phases(self) -> set[str]:
        """The agents' phases, see ``Estimate.phase``."""
        return set(self._phases.values())

    def settle(self) -> None:
        """Run until the cost of a block no longer changes much.

        Raises:
            CoheftError: Not every agent estimates the inertia by then.
        """
        seconds = max(SETTLED, _SETTLED_BLOCKS * self.block_duration)
        self.run_until(seconds)
        if len(self._phases) < len(self.graph) or self.phases != {"inertia"}:
            raise CoheftError(f"after {seconds:g} s not every agent estimates the inertia: a start would be measured")

    def step(self) -> tuple[float, float]:
        """Run one block; return the CPU times of all agents and of the physics [s]."""
        began = time.process_time()
        result = self._team.measure()
        between = time.process_time()
        self.outboxes = self._team.answer(measured(result), self._team.heard())
        ended = time.process_time()
        for name, outbox in self.outboxes.items():
            if outbox.estimate is not None:
                self._phases[name] = outbox.estimate.phase
        return ended - between, between - began

    def run_until(self, seconds: float) -> None:
        """Run all blocks up to a simulated time [s]."""
        while self.block * self.block_duration < seconds:
            self.step()

    def turn(self) -> None:
        """Run some blocks, and add their times to ``agents`` and ``physics``."""
        agents, physics = map(sum, zip(*(self.step() for _ in range(_TURN)), strict=True))
        self.agents.append(agents / _TURN / len(self.graph))
        self.physics.append(physics / _TURN)
