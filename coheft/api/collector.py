"""Collects the estimates of a run for its result."""

from dataclasses import replace

from coheft.api.result import Result
from coheft.api.tracks import robot_result
from coheft.app.results.report import Report
from coheft.app.run.follower import Follower
from coheft.app.run.news import News
from coheft.app.run.pairing import Pairing
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.wire.messages.requests import Status
from coheft.wire.messages.structs import Estimate
from coheft.wire.messages.truth import Scene
from coheft.wire.scenario.plugins import estimator_names
from coheft.wire.scenario.schema import Scenario


class Collector(Follower):
    """Collects the estimates of a run with the truth. Its memory grows with the run."""

    def begin(self, status: Status) -> None:
        """See ``Follower.begin``."""
        self.look_at(status.scene, status.estimator)

    def look_at(self, scene: Scene, estimator: str) -> None:
        """Use the robots and grasps of a scene, and the estimators that a scenario names."""
        names = estimator_names(estimator)
        self._pairing = Pairing(scene, names)
        self._kept: dict[str, dict[str, list[tuple[Estimate, Inertia]]]] = {
            name: {robot: [] for robot in scene.robots} for name in names
        }

    def receive(self, news: News) -> None:
        """See ``Follower.receive``."""
        for name, estimate in self._pairing.receive(news):
            truth = self._pairing.judge.payload(estimate.robot, estimate.block)
            self._kept[name][estimate.robot].append((estimate, truth))

    def result(self, scenario: Scenario, report: Report) -> Result:
        """Return the result so far, with the report of the same run."""
        own, *_ = self._kept
        beside = {name: self._result(scenario, name, each) for name, each in report.beside.items()}
        return replace(self._result(scenario, own, report), beside=beside)

    def _result(self, scenario: Scenario, estimator: str, report: Report) -> Result:
        kept = self._kept[estimator].items()
        robots = {robot: robot_result(self._pairing.judge, robot, found) for robot, found in kept}
        return Result(scenario, robots, report)
