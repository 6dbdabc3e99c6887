"""The state of a run that the view shows, live or in replay, independent of a browser."""

from collections import deque
from itertools import combinations
from typing import Literal

from coheft.app.results.judge import RobotReport
from coheft.app.results.points import make_point
from coheft.app.results.record import SILENT, Record
from coheft.app.run.news import News
from coheft.app.view.traces import Trace
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.wire.messages.requests import Status
from coheft.wire.messages.structs import Estimate, Problem
from coheft.wire.messages.truth import LoadState
from coheft.wire.scenario.plugins import estimator_names

LinkHealth = Literal["up", "silent", "unknown"]
_MOST_PROBLEMS = 100

Edge = tuple[str, str]
"""Two neighbours, in the order of the scene."""


class ViewModel:
    """The state of a run, from the messages that were received.

    Attributes:
        record: What was received, compared with the truth.
        edges: Edges of the graph, each once.
        problems: Problems with the time of their arrival [s], latest last.
        traces: Errors over time, by robot, and by estimator as in ``reports``.
        changes: Number of changes so far; a drawing is up to date while it stays the same.
    """

    def __init__(self, status: Status) -> None:
        self.status = status
        self.scene = status.scene
        robots, neighbours = self.scene.robots, self.scene.neighbours
        self.edges: list[Edge] = [(one, other) for one, other in combinations(robots, 2) if other in neighbours[one]]
        self.record = Record(self.scene, status.duration, status.estimator)
        own, *_ = estimator_names(status.estimator)
        self._records = {own: self.record, **self.record.beside}
        self.traces = {name: {estimator: Trace() for estimator in self._records} for name in robots}
        self.problems: deque[tuple[float, Problem]] = deque(maxlen=_MOST_PROBLEMS)
        self.changes = 0

    def receive(self, news: News) -> None:
        """Add a received message."""
        self.changes += 1
        if isinstance(news, Problem):
            self.problems.append((self.record.time, news))
        for estimator, estimate in self.record.receive(news):
            self.traces[estimate.robot][estimator].add(make_point(self.record.judge, estimate))

    def note_status(self, status: Status) -> None:
        """Set the status."""
        if status.loads != self.status.loads:
            self.changes += 1
        self.status = status

    @property
    def loads(self) -> list[LoadState]:
        """Loads on the payload, from the server's latest message: since a pause, the status is newer than the truth."""
        truth, status = self.record.truth, self.status
        return status.loads if truth is None or status.block > truth.block else truth.loads

    @property
    def disturbances(self) -> dict[tuple[str, ...], str]:
        """What the operator has disturbed, in words, by sender and receiver of messages, or by a clock's robot."""
        found: dict[tuple[str, ...], str] = {
            (sender, name): quality.in_words
            for name, estimate in self.record.latest.items()
            for sender, quality in estimate.disturbed.items()
        }
        clocks = {} if self.record.truth is None else self.record.truth.clocks
        return found | {(robot,): f"{ahead:g} s ahead" for robot, ahead in clocks.items()}

    @property
    def estimator(self) -> str:
        """Name of the estimator in use."""
        newest = max(self.record.latest.values(), key=lambda estimate: estimate.block, default=None)
        return self.status.estimator if newest is None else newest.estimator

    def reports(self, robot: str) -> dict[str, tuple[RobotReport, Estimate] | None]:
        """Return a robot's latest estimate, after its comparison with the truth; None if there is none yet.

        There is one by each estimator with which the run was begun, the robots' own first.
        """
        found: dict[str, tuple[RobotReport, Estimate] | None] = {}
        for estimator, record in self._records.items():
            report = record.robots[robot].report
            belief = record.beliefs.get(robot)
            found[estimator] = None if report is None or belief is None else (report.as_of_now(belief), belief)
        return found

    def believed_payload(self, robot: str) -> Inertia | None:
        """Return a robot's estimate of the payload in the payload's frame; None while it is not complete."""
        estimate = self.record.latest.get(robot)
        payload = estimate.payload if estimate is not None else None
        if estimate is None or payload is None or payload.com is None or payload.tensor is None:
            return None
        pose_robot_in_payload = self.record.judge.pose_payload_in(robot, estimate.block).inverse()
        return Inertia(payload.mass, payload.com, payload.tensor).transported(pose_robot_in_payload)

    def link(self, edge: Edge) -> LinkHealth:
        """Return the state of a link, as reported by the robots at its ends."""
        ends = [self.record.latest.get(name) for name in edge]
        if any(end is not None and other in end.silent for end, other in zip(ends, reversed(edge), strict=True)):
            return "silent"
        newest = 0 if self.record.truth is None else self.record.truth.block
        return "unknown" if any(end is None or newest - end.block > SILENT for end in ends) else "up"
