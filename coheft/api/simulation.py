"""A run in this process, block by block, with the caller's code in between."""

import time

import msgspec

from coheft.api.collector import Collector
from coheft.api.result import Result
from coheft.app.names import check_link
from coheft.app.results.record import Record
from coheft.app.results.report import build_report
from coheft.app.run.inprocess import TeamInProcess, measured
from coheft.app.run.news import News
from coheft.errors import CoheftError
from coheft.wire.messages.structs import Estimate
from coheft.wire.messages.truth import Truth
from coheft.wire.scenario.schema import Scenario
from coheft.wire.scenario.section import Vector


class Simulation:
    """A simulated team and its payload; made by ``coheft.simulate``.

    Without interventions, the numbers are those of ``coheft run`` in lockstep, bit for bit.

    Attributes:
        scenario: The scenario.
        truth: The truth after the last block; None before the first.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.truth: Truth | None = None
        self._team = TeamInProcess(scenario)
        scene = self._team.simulation.scene
        self._record = Record.of(scenario, scene)
        self._collector = Collector()
        self._collector.look_at(scene, scenario.estimator)
        self._cut: set[frozenset[str]] = set()
        self._is_holding = dict.fromkeys(scene.robots, True)
        self._began = time.monotonic()

    @property
    def robots(self) -> tuple[str, ...]:
        """The robots' names."""
        return self.scenario.robot_names

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return 0.0 if self.truth is None else self.truth.time

    @property
    def is_over(self) -> bool:
        """Whether the scenario's duration is over; the simulation can still be continued."""
        return self._team.simulation.block >= self.scenario.blocks

    @property
    def estimates(self) -> dict[str, Estimate]:
        """The latest estimate of each robot, by name; robots without one are left out."""
        return self._record.beliefs

    def step(self, blocks: int = 1) -> None:
        """Advance by some blocks of samples.

        Raises:
            SimulationError: The robots have lost the payload; nothing more can be simulated.
        """
        for _ in range(blocks):
            result = self._team.measure()
            for name, measurements in result.measurements.items():
                if measurements.holding != self._is_holding[name]:
                    self._is_holding[name] = measurements.holding
                    self._team.agents[name].set_holding(measurements.holding, measurements.block)
            received = {
                name: [message for message in messages if frozenset((name, message.sender)) not in self._cut]
                for name, messages in self._team.received().items()
            }
            outboxes = self._team.answer(measured(result), received).values()
            self.truth = result.truth
            estimates = [outbox.estimate for outbox in outboxes if outbox.estimate is not None]
            all_news: list[News] = [result.truth, *estimates, *(each for outbox in outboxes for each in outbox.beside)]
            for news in all_news:
                self._record.receive(news)
                self._collector.receive(news)

    def run_until(self, time: float) -> None:
        """Advance until this time [s]."""
        while self.time < time - 1e-9:
            self.step()

    def inject(self, mass: float, at: Vector, size: Vector = (0.1, 0.1, 0.1), leak: float = 0.0) -> int:
        """Add a load to the payload, as ``coheft inject`` does; return its number.

        Args:
            mass: Mass of the load [kg].
            at: Position of its centre, in the payload's frame [m].
            size: Its edge lengths [m].
            leak: Mass that it loses from then on [kg/s].

        Raises:
            LoadError: Such a load is impossible, no more loads fit, or the robots cannot hold it.
        """
        return self._team.simulation.inject(mass, at, size, leak).id

    def remove(self, load: int) -> None:
        """Remove a load by its number.

        Raises:
            LoadError: There is no such load.
        """
        self._team.simulation.remove(load)

    def release(self, robot: str) -> None:
        """Let a robot release the payload.

        Raises:
            SimulationError: There is no such robot.
        """
        self._team.simulation.release(robot)

    def grasp(self, robot: str) -> None:
        """Let a robot grasp the payload again, in the same place as before.

        Raises:
            SimulationError: There is no such robot.
        """
        self._team.simulation.grasp(robot)

    def cut(self, one: str, other: str) -> None:
        """Cut the link between two neighbours: neither receives the other's messages any more.

        Raises:
            CoheftError: They are not neighbours.
        """
        check_link(self._team.graph, one, other)
        self._cut.add(frozenset((one, other)))

    def mend(self, one: str, other: str) -> None:
        """Restore a link that was cut.

        Raises:
            CoheftError: They are not neighbours.
        """
        check_link(self._team.graph, one, other)
        self._cut.discard(frozenset((one, other)))

    def result(self) -> Result:
        """Return the result so far.

        Raises:
            CoheftError: A robot has not published an estimate yet.
        """
        if self.truth is None or self._record.silent:
            raise CoheftError("there is no result before all robots have published estimates: call step() first")
        pace = self.time / max(1e-9, time.monotonic() - self._began)
        report = msgspec.structs.replace(
            build_report(self.scenario, self._record, real_time_factor=pace), processes=1, messages_per_s=0.0
        )
        return self._collector.result(self.scenario, report)
