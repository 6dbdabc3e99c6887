"""What an observer keeps of a run: all that the report says, in memory that does not grow with time."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from coheft.app.results.robot_record import LoadPeriod, RobotRecord
from coheft.app.results.slips import SlipRecord
from coheft.app.run.heard import News
from coheft.app.run.pairing import Pairing
from coheft.wire.messages.scene import Scene
from coheft.wire.messages.structs import Estimate, Truth

SILENT = 100
"""A robot that is so many blocks behind the truth is silent: no server runs so far ahead of its robots."""


class EstimatorUse(msgspec.Struct, frozen=True):
    """An estimator, and since when the robots have used it [s]."""

    since_s: float
    estimator: str


class Record:
    """Truths and estimates of a run, compared with each other as they come and then let go.

    An estimate waits until the truth of its block is there, so equal runs leave equal records, whatever came first.
    Kept are the newest truths, the newest estimate of each robot, sums, and for each change of the load what each robot
    believed before and how it went on.

    Args:
        scene: Who holds the payload where.
        duration: Of the whole run [s].
        with_history: Keep every robot's errors about once a second, too; this grows with time.

    Attributes:
        judge: Knows the newest truths.
        blocks: Number of truths that have come.
        periods: Of the load; the first one begins with the first truth.
        robots: What is kept of each robot's estimates.
        latest: The newest estimate of each robot that has said something, as it said it.
        estimators: Which ones the robots have used, the newest last.
        slips: Grasps that have slipped.
    """

    def __init__(self, scene: Scene, duration: float, *, with_history: bool = False) -> None:
        self.scene = scene
        self.duration = duration
        self._pairing = Pairing(scene)
        self.judge = self._pairing.judge
        self.blocks = 0
        self.with_history = with_history
        self.periods: list[LoadPeriod] = []
        self.robots = {name: RobotRecord(self.judge, self.periods, with_history=with_history) for name in scene.robots}
        self.latest: dict[str, Estimate] = {}
        self.estimators: list[EstimatorUse] = []
        self.slips = SlipRecord(self.judge)

    @property
    def truth(self) -> Truth | None:
        """The newest of all."""
        return self._pairing.truth

    @property
    def time(self) -> float:
        """Simulated time that has been heard of [s]."""
        return 0.0 if self.truth is None else self.truth.time

    @property
    def silent(self) -> list[str]:
        """Robots of which no estimate has been compared yet."""
        return [name for name, robot in self.robots.items() if robot.compared == 0]

    @property
    def beliefs(self) -> dict[str, Estimate]:
        """The newest estimate of each robot, in the scene's order; stale where the robot has fallen silent."""
        return {name: as_of_now(self.latest[name], self.truth) for name in self.scene.robots if name in self.latest}

    @property
    def complete(self) -> bool:
        """Whether every robot's estimate of the newest truth's block has come."""
        newest = self.truth
        return newest is not None and not self.silent and all(e.block >= newest.block for e in self.latest.values())

    def hear(self, news: News) -> None:
        """Take in what an observer has heard."""
        match news:
            case Truth():
                self.add_truth(news)
            case Estimate():
                self.add_estimate(news)
            case _:
                pass

    def add_truth(self, truth: Truth) -> None:
        """Take in the truth about one more block."""
        if self.truth is None or load_ids(truth) != load_ids(self.truth):
            self.periods.append(LoadPeriod(loads_since(truth), truth))
        self.blocks += 1
        self.slips.follow(truth)
        self._compare(self._pairing.add_truth(truth))

    def add_estimate(self, estimate: Estimate) -> None:
        """Take in what a robot of the scene believes."""
        self.latest[estimate.robot] = estimate
        self._note_estimator(estimate)
        self._compare(self._pairing.add_estimate(estimate))

    def _note_estimator(self, estimate: Estimate) -> None:
        """All robots change at the same block, and say so after it; what was said before it may come later."""
        since = estimate.time * estimate.block / (estimate.block + 1)
        newest = self.estimators[-1] if self.estimators else None
        if newest is None or (since > newest.since_s and estimate.estimator != newest.estimator):
            self.estimators.append(EstimatorUse(round(since, 9), estimate.estimator))

    def _compare(self, estimates: Iterable[Estimate]) -> None:
        """Compare estimates of which the truth has come."""
        for estimate in estimates:
            self.robots[estimate.robot].compare(estimate)


def loads_since(truth: Truth) -> float:
    """When the loads became what they are [s]; at the block's beginning, where the truth does not say."""
    return truth.time * truth.block / (truth.block + 1) if truth.loads_since is None else truth.loads_since


def load_ids(truth: Truth) -> list[int]:
    """What lies on the payload; a load that leaks stays the same load."""
    return [load.id for load in truth.loads]


def as_of_now(estimate: Estimate, truth: Truth | None) -> Estimate:
    """The newest estimate of a robot, stale if it has said nothing for long; ``truth`` is the newest there is."""
    if truth is None or truth.block - estimate.block <= SILENT:
        return estimate
    reason = f"{estimate.robot} has said nothing since {estimate.time:.2f} s"
    return msgspec.structs.replace(estimate, status="stale", reasons=[reason])
