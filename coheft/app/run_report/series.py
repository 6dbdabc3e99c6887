"""What happened in a run over time, in memory that does not grow with its duration."""

import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Generic, TypeVar

import numpy as np

from coheft.app.results.points import Point, make_point
from coheft.app.results.record import load_ids, loads_since
from coheft.app.results.states import State
from coheft.app.run.follower import Follower
from coheft.app.run.news import News
from coheft.app.run.pairing import Pairing
from coheft.wire.messages.requests import Status
from coheft.wire.messages.structs import Estimate, Problem
from coheft.wire.messages.truth import Scene, Truth
from coheft.wire.scenario.plugins import estimator_names

MOST_ROBOTS = 24
"""Largest number of robots that are drawn; what follows is the number of items that are kept."""
_POINTS = 20_000  # of all robots together
_MOMENTS = 1_000
_PACE = 4_000
_CLOSE_UPS = 6
_PROBLEMS = 100
_SPANS = 400
"""Longest list of spans; then the shortest of them becomes part of the one before."""
BEFORE, AFTER = 0.5, 3.0
"""Time before and after a change of the load that a close-up shows [s]."""

T = TypeVar("T")


class Thinned(Generic[T]):
    """At most ``capacity`` evenly spread items of a series, one of ``every``: all, of 2, of 4, …; and the last."""

    def __init__(self, capacity: int) -> None:
        self.every = 1
        self._capacity = capacity
        self._items: list[T] = []
        self._seen = 0
        self._last: T | None = None

    def add(self, item: T) -> None:
        """Add the next item."""
        self._last = item
        if self._seen % self.every == 0:
            if len(self._items) == self._capacity:
                del self._items[1::2]
                self.every *= 2
            if self._seen % self.every == 0:
                self._items.append(item)
        self._seen += 1

    def __iter__(self) -> Iterator[T]:
        yield from self._items
        if self._items and self._last is not None and self._last is not self._items[-1]:
            yield self._last


@dataclass(frozen=True, slots=True)
class Span:
    """A time [s] in which a robot reported the same about its knowledge."""

    start: float
    end: float
    state: State
    not_observable: tuple[str, ...]
    reasons: tuple[str, ...]


def add_span(spans: list[Span], estimate: Estimate) -> None:
    """Add a robot's next estimate, which is for the time since the one before."""
    start = spans[-1].end if spans else 0.0
    new = Span(start, estimate.time, State.of(estimate), tuple(estimate.not_observable), tuple(estimate.reasons))
    if spans and new == replace(spans[-1], start=new.start, end=new.end):
        spans[-1] = replace(spans[-1], end=new.end)
        return
    spans.append(new)
    if len(spans) > _SPANS:
        shortest = min(range(1, _SPANS), key=lambda k: spans[k].end - spans[k].start)
        spans[shortest - 1] = replace(spans[shortest - 1], end=spans[shortest].end)
        del spans[shortest]


@dataclass(eq=False)
class CloseUp:
    """The time around one change of the load; ``masses`` are times [s] and true masses of the payload [kg]."""

    at: float
    masses: list[tuple[float, float]]
    points: dict[str, list[Point]]


class RobotSeries:
    """One robot's estimates over time: evenly spread ones, spans of time with its states, and the newest estimates."""

    def __init__(self, capacity: int) -> None:
        self.points: Thinned[Point] = Thinned(capacity)
        self.spans: list[Span] = []
        self.recent: deque[Point] = deque(maxlen=50)


@dataclass(eq=False)
class Series:
    """All data that the report draws.

    Attributes:
        by_estimator: Each robot's estimates, by name, in the scene's order; of the estimator with which the run began,
            the robots' own, and of each that ran beside it.
        moments: Truths, some of them, evenly spread.
        pace: Simulated times, and the wall-clock times of their arrival [s]; empty for a recording.
        problems: The first problems that processes reported, with their simulated times.
    """

    scene: Scene
    by_estimator: dict[str, dict[str, RobotSeries]]
    moments: Thinned[Truth] = field(default_factory=lambda: Thinned(_MOMENTS))
    close_ups: list[CloseUp] = field(default_factory=list)
    pace: Thinned[tuple[float, float]] = field(default_factory=lambda: Thinned(_PACE))
    problems: list[tuple[float, Problem]] = field(default_factory=list)
    problem_count: int = 0

    @property
    def estimator(self) -> str:
        """The estimator with which the run began, the robots' own."""
        return next(iter(self.by_estimator))

    @property
    def robots(self) -> dict[str, RobotSeries]:
        """Each robot's own estimates."""
        return self.by_estimator[self.estimator]

    @property
    def beside(self) -> list[str]:
        """The estimators that ran beside the robots' own."""
        return list(self.by_estimator)[1:]

    @property
    def drawn(self) -> list[str]:
        """The robots that are drawn: all, or evenly spread ones of many."""
        names = list(self.robots)
        if len(names) <= MOST_ROBOTS:
            return names
        return [names[k] for k in np.linspace(0, len(names) - 1, MOST_ROBOTS).round().astype(int)]


class SeriesFollower(Follower):
    """Follows a run, and keeps what the report draws; a recording is not live, so it has no pace."""

    series: Series
    is_live = True

    def begin(self, status: Status) -> None:
        """See ``Follower.begin``."""
        robots, estimators = status.scene.robots, estimator_names(status.estimator)
        capacity = max(100, _POINTS // (len(robots) * len(estimators)))
        self.series = Series(status.scene, {e: {r: RobotSeries(capacity) for r in robots} for e in estimators})
        self._pairing = Pairing(status.scene, estimators)
        self._masses: deque[tuple[float, float]] = deque(maxlen=500)

    def receive(self, news: News) -> None:
        """See ``Follower.receive``."""
        match news:
            case Truth():
                self._note_truth(news)
            case Problem():
                self.series.problem_count += 1
                if len(self.series.problems) < _PROBLEMS:
                    now = self._pairing.truth
                    self.series.problems.append((0.0 if now is None else now.time, news))
        for estimator, estimate in self._pairing.receive(news):
            self._keep(estimator, estimate)

    def _note_truth(self, truth: Truth) -> None:
        before, series, start = self._pairing.truth, self.series, loads_since(truth)
        is_changed = before is not None and load_ids(before) != load_ids(truth)
        # A recording that was damaged may have a gap instead of what a close-up shows.
        if is_changed and truth.time <= start + AFTER and len(series.close_ups) < _CLOSE_UPS:
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

    def _keep(self, estimator: str, estimate: Estimate) -> None:
        """Keep an estimate that can be compared; close-ups show the robots' own only."""
        robot = self.series.by_estimator[estimator][estimate.robot]
        point = make_point(self._pairing.judge, estimate)
        robot.points.add(point)
        robot.recent.append(point)
        add_span(robot.spans, estimate)
        for close_up in self.series.close_ups if estimator == self.series.estimator else ():
            if close_up.at - BEFORE <= point.time <= close_up.at + AFTER:
                close_up.points[estimate.robot].append(point)
