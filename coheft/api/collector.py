"""Collects the estimates of a run for its result."""

from collections.abc import Sequence

from coheft.api.result import Result
from coheft.api.tracks import robot_result
from coheft.app.results.report import Report
from coheft.app.run.follower import Follower
from coheft.app.run.heard import News
from coheft.app.run.pairing import Pairing
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.wire.messages.requests import Status
from coheft.wire.messages.scene import Scene
from coheft.wire.messages.structs import Estimate, EstimateBeside
from coheft.wire.messages.truth import Truth
from coheft.wire.scenario.plugins import estimator_names
from coheft.wire.scenario.schema import Scenario


class Collector(Follower):
    """Collects the estimates of a run with the truth. Its memory grows with the run."""

    def begin(self, status: Status) -> None:
        """See ``Follower.begin``."""
        self.look_at(status.scene, estimator_names(status.estimator)[1:])

    def look_at(self, scene: Scene, beside: Sequence[str] = ()) -> None:
        """Use the robots and grasps of a scene; ``beside`` names the estimators that run beside the robots' own."""
        self._pairing = Pairing(scene)
        self._kept: dict[str, list[tuple[Estimate, Inertia]]] = {name: [] for name in scene.robots}
        self._beside = {name: Collector() for name in beside}
        for other in self._beside.values():
            other.look_at(scene)

    def receive(self, news: News) -> None:
        """See ``Follower.receive``."""
        ready: list[Estimate] = []
        if isinstance(news, Truth):
            ready = self._pairing.add_truth(news)
            for other in self._beside.values():
                other.receive(news)
        elif isinstance(news, Estimate):
            ready = self._pairing.add_estimate(news)
        elif isinstance(news, EstimateBeside) and news.estimate.estimator in self._beside:
            self._beside[news.estimate.estimator].receive(news.estimate)
        for estimate in ready:
            truth = self._pairing.judge.payload(estimate.robot, estimate.block)
            self._kept[estimate.robot].append((estimate, truth))

    def result(self, scenario: Scenario, report: Report) -> Result:
        """Return the result so far, with the report of the same run."""
        beside = {name: self._beside[name].result(scenario, each) for name, each in report.beside.items()}
        robots = {name: robot_result(self._pairing.judge, name, kept) for name, kept in self._kept.items()}
        return Result(scenario, robots, report, beside)
