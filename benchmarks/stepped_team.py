"""Agents and their physics in one process, block by block: what benchmarks time and record."""

from __future__ import annotations

import time

from coheft.agents.agent import Outbox
from coheft.app.run.inprocess import TeamInProcess, measured
from coheft.errors import CoheftError
from coheft.wire.scenario.schema import Scenario

SETTLED = 12.0
"""From then on a team does what it does for the rest of the run [s]: fits have become rare by then."""
_SETTLED_BLOCKS = 150
"""The same for long blocks: much of a start takes a number of blocks, however long they are."""


class SteppedTeam:
    """A team and its physics in this process; time is counted separately for both.

    Attributes:
        block_duration: Of one block [s].
        graph: Who talks with whom.
        outboxes: What each agent said last.
        agents_time: CPU time of all agents so far [s].
        physics_time: CPU time of physics and sensors so far [s].
    """

    def __init__(self, scenario: Scenario) -> None:
        self.block_duration = scenario.block_duration
        self._team = TeamInProcess(scenario)
        self.graph = self._team.graph
        self.outboxes: dict[str, Outbox] = {}
        self.agents_time = self.physics_time = 0.0
        self._phases: dict[str, str] = {}

    @property
    def block(self) -> int:
        """Number of blocks so far."""
        return self._team.simulation.block

    def settle(self) -> None:
        """All blocks until a team does what it does for the rest of the run.

        Raises:
            CoheftError: Not every agent weighs the load then: it is no team like those that are measured.
        """
        seconds = max(SETTLED, _SETTLED_BLOCKS * self.block_duration)
        self.run_until(seconds)
        if not self.is_working:
            raise CoheftError(f"after {seconds:g} s not every agent weighs the load: what would be measured is a start")

    @property
    def is_working(self) -> bool:
        """Whether every agent weighs the load."""
        return len(self._phases) == len(self.graph) and self.phases == {"inertia"}

    @property
    def phases(self) -> set[str]:
        """What agents have said last that they are at, see ``Estimate.phase``."""
        return set(self._phases.values())

    def step(self) -> None:
        """One block."""
        began = time.process_time()
        result = self._team.measure()
        between = time.process_time()
        self.outboxes = self._team.answer(measured(result), self._team.heard())
        ended = time.process_time()
        self.physics_time += between - began
        self.agents_time += ended - between
        for name, outbox in self.outboxes.items():
            if outbox.estimate is not None:
                self._phases[name] = outbox.estimate.phase

    def run_until(self, seconds: float) -> None:
        """All blocks up to a simulated time [s]."""
        while self.block * self.block_duration < seconds:
            self.step()
