"""Collects the estimates of a run for its result."""

from __future__ import annotations

from coheft.api.tracks import RobotResult, robot_result
from coheft.app.results.judge import Judge
from coheft.app.run.follower import Follower
from coheft.app.run.heard import News
from coheft.app.run.pairing import Pairing
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.wire.messages.requests import Status
from coheft.wire.messages.scene import Scene
from coheft.wire.messages.structs import Estimate, Truth


class Collector(Follower):
    """Follows a run. Its memory grows with the run."""

    def begin(self, status: Status) -> None:
        """All links stand and the clock runs."""
        self.look_at(status.scene)

    def look_at(self, scene: Scene) -> None:
        """Who holds the payload where."""
        self._pairing = Pairing(scene)
        self._kept: dict[str, list[tuple[Estimate, Inertia]]] = {name: [] for name in scene.robots}

    def hear(self, news: News) -> None:
        """Take in what an observer has heard."""
        ready: list[Estimate] = []
        if isinstance(news, Truth):
            ready = self._pairing.add_truth(news)
        elif isinstance(news, Estimate):
            ready = self._pairing.add_estimate(news)
        for estimate in ready:
            truth = self._judge.payload(estimate.robot, estimate.block)
            self._kept[estimate.robot].append((estimate, truth))

    @property
    def _judge(self) -> Judge:
        return self._pairing.judge

    def robots(self) -> dict[str, RobotResult]:
        """What each robot said so far."""
        return {
            name: robot_result(self._judge, name, [e for e, _ in kept], [truth for _, truth in kept])
            for name, kept in self._kept.items()
        }
