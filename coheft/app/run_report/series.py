"""What happened in a run over time, in memory that does not grow with its duration."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, field

from coheft.app.results.record import load_ids, loads_since
from coheft.app.run.follower import Follower
from coheft.app.run.heard import News
from coheft.app.run.pairing import Pairing
from coheft.app.run_report.points import Point, make_point
from coheft.app.run_report.states import Spans
from coheft.app.run_report.thinned import Thinned
from coheft.wire.messages.requests import Status
from coheft.wire.messages.scene import Scene
from coheft.wire.messages.structs import Estimate, EstimateBeside, Problem
from coheft.wire.messages.truth import Truth
from coheft.wire.scenario.plugins import estimator_names

_POINTS = 20_000
"""Number of points that are kept, of all robots together."""
_MOMENTS = 4_000
"""Number of moments of the pace that are kept."""
_SHOWN = 1_000
"""Number of moments of the scene that are kept."""
_CLOSE_UPS = 6
_PROBLEMS = 100
BEFORE, AFTER = 0.5, 3.0
"""Time before and after a change of the load that a close-up shows [s]."""


@dataclass(eq=False)
class CloseUp:
    """The time around one change of the load.

    Attributes:
        at: Time of the change [s].
        masses: Times [s] and true masses of the payload [kg].
        points: All estimates of each robot.
    """

    at: float
    masses: list[tuple[float, float]]
    points: dict[str, list[Point]]


class RobotSeries:
    """One robot's estimates over time.

    Attributes:
        points: Some of them, evenly spread.
        states: Its states.
        recent: The newest ones.
    """

    def __init__(self, capacity: int) -> None:
        self.points: Thinned[Point] = Thinned(capacity)
        self.states = Spans()
        self.recent: deque[Point] = deque(maxlen=50)


@dataclass(eq=False)
class Series:
    """All data that the report draws.

    Attributes:
        scene: The scene, with the grasps.
        robots: Each robot's estimates, by name, in the scene's order.
        estimator: The estimator with which the run began, the robots' own.
        beside: The same as ``robots`` of the estimators that ran beside it, by name.
        moments: Truths, some of them, evenly spread.
        close_ups: The first changes of the load.
        pace: Simulated times, and the wall-clock times of their arrival [s]; empty for a recording.
        problems: The first problems that processes reported, with their simulated times.
        problem_count: Number of all problems.
    """

    scene: Scene
    robots: dict[str, RobotSeries]
    estimator: str = ""
    beside: dict[str, dict[str, RobotSeries]] = field(default_factory=dict)
    moments: Thinned[Truth] = field(default_factory=lambda: Thinned(_SHOWN))
    close_ups: list[CloseUp] = field(default_factory=list)
    pace: Thinned[tuple[float, float]] = field(default_factory=lambda: Thinned(_MOMENTS))
    problems: list[tuple[float, Problem]] = field(default_factory=list)
    problem_count: int = 0

    @property
    def by_estimator(self) -> dict[str, dict[str, RobotSeries]]:
        """``robots`` of each estimator, the robots' own first."""
        return {self.estimator: self.robots, **self.beside}


class SeriesFollower(Follower):
    """Follows a run, and keeps what the report draws.

    Attributes:
        series: The data so far.
        is_live: Whether the run is in progress, so that it has a pace; a recording has none.
    """

    series: Series
    is_live = True

    def begin(self, status: Status) -> None:
        """See ``Follower.begin``."""
        names = status.scene.robots
        own, *others = estimator_names(status.estimator)
        capacity = max(100, _POINTS // (len(names) * (1 + len(others))))
        robots, *beside = ({name: RobotSeries(capacity) for name in names} for _ in (own, *others))
        self.series = Series(status.scene, robots, own, dict(zip(others, beside, strict=True)))
        self._pairing = Pairing(status.scene)
        self._pairings_beside = {name: Pairing(status.scene) for name in others}
        self._masses: deque[tuple[float, float]] = deque(maxlen=500)

    def hear(self, news: News) -> None:
        """See ``Follower.hear``."""
        match news:
            case Truth():
                self._add_truth(news)
            case Estimate():
                self._keep(self._pairing.add_estimate(news))
            case EstimateBeside(estimate=estimate):
                if (pairing := self._pairings_beside.get(estimate.estimator)) is not None:
                    self._keep_beside(pairing.add_estimate(estimate))
            case Problem():
                self.series.problem_count += 1
                if len(self.series.problems) < _PROBLEMS:
                    now = self._pairing.truth
                    self.series.problems.append((0.0 if now is None else now.time, news))

    def _add_truth(self, truth: Truth) -> None:
        before, series = self._pairing.truth, self.series
        if before is not None and load_ids(before) != load_ids(truth) and len(series.close_ups) < _CLOSE_UPS:
            start = loads_since(truth)
            points = {
                name: [p for p in robot.recent if p.time >= start - BEFORE] for name, robot in series.robots.items()
            }
            series.close_ups.append(CloseUp(start, [m for m in self._masses if m[0] >= start - BEFORE], points))
        self._masses.append((truth.time, truth.payload.mass))
        for close_up in series.close_ups:
            if truth.time <= close_up.at + AFTER:
                close_up.masses.append(self._masses[-1])
        series.moments.add(truth)
        if self.is_live:
            series.pace.add((truth.time, time.monotonic()))
        self._keep(self._pairing.add_truth(truth))
        for pairing in self._pairings_beside.values():
            self._keep_beside(pairing.add_truth(truth))

    def _keep(self, estimates: list[Estimate]) -> None:
        for estimate in estimates:
            robot, point = self.series.robots[estimate.robot], make_point(self._pairing.judge, estimate)
            robot.points.add(point)
            robot.recent.append(point)
            robot.states.add(estimate)
            for close_up in self.series.close_ups:
                if close_up.at - BEFORE <= point.time <= close_up.at + AFTER:
                    close_up.points[estimate.robot].append(point)

    def _keep_beside(self, estimates: list[Estimate]) -> None:
        for estimate in estimates:
            robot = self.series.beside[estimate.estimator][estimate.robot]
            robot.points.add(make_point(self._pairing.judge, estimate))
            robot.states.add(estimate)
