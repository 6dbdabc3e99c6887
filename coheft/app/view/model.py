"""What there is to show of a run: news in, answers out. Live and in replay alike, and without any browser."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import Literal

import msgspec

from coheft.app.results.judge import RobotReport
from coheft.app.results.record import SILENT, as_of_now
from coheft.app.run.heard import News
from coheft.app.run.pairing import Pairing
from coheft.app.view.traces import Trace
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.wire.messages.requests import Status
from coheft.wire.messages.structs import Estimate, EstimateBeside, Problem
from coheft.wire.messages.truth import LoadState, Truth
from coheft.wire.scenario.plugins import estimator_names

LinkHealth = Literal["up", "silent", "unknown"]
_PROBLEMS = 100
"""Kept, newest last."""

Edge = tuple[str, str]
"""Two neighbours, in the order of the scene."""


class ViewModel:
    """A run as far as it has been heard of.

    Args:
        status: How the run is; what does not change comes with it.

    Attributes:
        status: The newest one.
        scene: What does not change.
        edges: Who talks with whom, each edge once.
        truth: The newest one.
        problems: With the time at which they were heard [s].
        beside: The same of the estimators that run beside the robots' own, by name.
        changes: Counts news: who has drawn a picture need not draw it again while this stays.
    """

    def __init__(self, status: Status) -> None:
        self.status = status
        self.scene = status.scene
        order = {name: index for index, name in enumerate(self.scene.robots)}
        self.edges: list[Edge] = sorted(
            {
                (name, other) if order[name] < order[other] else (other, name)
                for name, others in self.scene.neighbours.items()
                for other in others
            },
            key=lambda edge: (order[edge[0]], order[edge[1]]),
        )
        self._pairing = Pairing(self.scene)
        self.truth: Truth | None = None
        self._latest: dict[str, Estimate] = {}
        self._reports: dict[str, RobotReport] = {}
        self._traces = {name: Trace() for name in order}
        self.problems: deque[tuple[float, Problem]] = deque(maxlen=_PROBLEMS)
        self.beside = {
            name: ViewModel(msgspec.structs.replace(status, estimator=name))
            for name in estimator_names(status.estimator)[1:]
        }
        self.changes = 0

    def hear(self, news: News) -> None:
        """Take in what an observer has heard."""
        self.changes += 1
        match news:
            case Truth():
                self.truth = news
                self._compare(self._pairing.add_truth(news))
                for other in self.beside.values():
                    other.hear(news)
            case Estimate():
                self._latest[news.robot] = news
                self._compare(self._pairing.add_estimate(news))
            case EstimateBeside(estimate=estimate):
                if (beside := self.beside.get(estimate.estimator)) is not None:
                    beside.hear(estimate)
            case Problem():
                self.problems.append((self.time, news))

    def note_status(self, status: Status) -> None:
        """Take in how the run is."""
        if status.loads != self.status.loads:
            self.changes += 1
        self.status = status

    def _compare(self, estimates: Iterable[Estimate]) -> None:
        """Compare estimates with the truth of their block."""
        for estimate in estimates:
            report = self._pairing.judge.robot([estimate])
            self._reports[estimate.robot] = report
            self._traces[estimate.robot].add(report)

    @property
    def time(self) -> float:
        """Simulated time that has been heard of [s]."""
        return 0.0 if self.truth is None else self.truth.time

    @property
    def loads(self) -> list[LoadState]:
        """What lies on the payload: by the newest word of the server, which knows more while time stands still."""
        truth, status = self.truth, self.status
        if truth is None or (status.state == "paused" and status.block > truth.block):
            return status.loads
        return truth.loads

    @property
    def estimator(self) -> str:
        """The one that the robots use."""
        newest = max(self._latest.values(), key=lambda estimate: estimate.block, default=None)
        return self.status.estimator if newest is None else newest.estimator

    @property
    def beliefs(self) -> dict[str, Estimate]:
        """The newest estimate of each robot, in the scene's order; stale where the robot has fallen silent."""
        return {name: as_of_now(self._latest[name], self.truth) for name in self.scene.robots if name in self._latest}

    def report(self, robot: str) -> RobotReport | None:
        """A robot's newest belief against the truth, as the run's report tells it; None if there is none yet."""
        report = self._reports.get(robot)
        if report is None:
            return None
        return report.as_of_now(as_of_now(self._latest[robot], self.truth))

    def trace(self, robot: str) -> Trace:
        """A robot's errors over time."""
        return self._traces[robot]

    def believed_payload(self, robot: str) -> Inertia | None:
        """What a robot takes the payload for, in the payload's own frame; None as long as it does not know all."""
        estimate = self._latest.get(robot)
        payload = estimate.payload if estimate is not None else None
        if estimate is None or payload is None or payload.com is None or payload.tensor is None:
            return None
        pose_robot_in_payload = self._pairing.judge.pose_payload_in(robot, estimate.block).inverse()
        return Inertia(payload.mass, payload.com, payload.tensor).carried(pose_robot_in_payload)

    def link(self, edge: Edge) -> LinkHealth:
        """How a link is, as the robots at its ends say."""
        ends = [self._latest.get(name) for name in edge]
        if any(end is not None and other in end.silent for end, other in zip(ends, reversed(edge), strict=True)):
            return "silent"
        if any(end is None or (self.truth is not None and self.truth.block - end.block > SILENT) for end in ends):
            return "unknown"
        return "up"
