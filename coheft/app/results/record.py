"""An observer's record of a run: all data of the report, in memory that does not grow with time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

import msgspec

from coheft.app.results.robot_record import LoadPeriod, RobotRecord
from coheft.app.results.slips import SlipRecord
from coheft.app.run.news import News
from coheft.app.run.pairing import Pairing
from coheft.wire.messages.structs import Estimate, EstimateBeside, Validity
from coheft.wire.messages.truth import Scene, Truth
from coheft.wire.scenario.plugins import estimator_names
from coheft.wire.scenario.schema import Scenario

if TYPE_CHECKING:  # loads the physics
    from coheft.app.results.carry_record import CarryRecord

SILENT = 100
"""Number of blocks behind the truth after which a robot is silent; no server runs so far ahead of its robots."""


class EstimatorUse(msgspec.Struct, frozen=True):
    """An estimator, and the time from which the robots have used it [s]."""

    since_s: float
    estimator: str


class Record:
    """Compares estimates with truths as they arrive, and keeps what the report needs.

    An estimate waits until the truth of its block has arrived, so equal runs give equal records, whatever the order of
    arrival. The record keeps the newest truths, the newest estimate of each robot, sums, and for each load change each
    robot's estimate before and its recovery after it.

    Args:
        scene: The scene, with the grasps.
        duration: Duration of the whole run [s].
        estimator: Estimators that run side by side, the robots' own first, as in a scenario.
        with_history: Whether to keep every robot's errors about once a second, too; this grows with time.
        pairing: That of the record that this one is beside.

    Attributes:
        blocks: Number of truths that have arrived.
        periods: Periods between load changes; the first one begins with the first truth.
        latest: The newest estimate of each robot, as received.
        estimators: The estimators that the robots have used, the newest last.
        carried: How the load is carried along the common path; None if there is no path.
        beside: The same of the estimators that run beside the robots' own, by name.
    """

    def __init__(
        self,
        scene: Scene,
        duration: float,
        estimator: str = "",
        *,
        with_history: bool = False,
        pairing: Pairing | None = None,
    ) -> None:
        names = estimator_names(estimator)
        self.scene = scene
        self.duration = duration
        self._pairing = pairing or Pairing(scene, names)
        self.judge = self._pairing.judge
        self.blocks = 0
        self.with_history = with_history
        self.periods: list[LoadPeriod] = []
        self.robots = {name: RobotRecord(self.judge, self.periods, with_history=with_history) for name in scene.robots}
        self.latest: dict[str, Estimate] = {}
        self.estimators: list[EstimatorUse] = []
        self.slips = SlipRecord(self.judge)
        self.carried: CarryRecord | None = None
        self.beside = {
            name: Record(scene, duration, with_history=with_history, pairing=self._pairing) for name in names[1:]
        }

    @classmethod
    def of(cls, scenario: Scenario, scene: Scene, *, with_history: bool = False) -> Self:
        """Begin the record of a run of a scenario."""
        record = cls(scene, scenario.duration, scenario.estimator, with_history=with_history)
        if scenario.carry is not None:
            from coheft.app.results.carry_record import CarryRecord

            record.carried = CarryRecord(scenario, scene)
        return record

    @property
    def truth(self) -> Truth | None:
        """The newest truth."""
        return self._pairing.truth

    @property
    def time(self) -> float:
        """Simulated time of the newest truth [s]."""
        return 0.0 if self.truth is None else self.truth.time

    @property
    def silent(self) -> list[str]:
        """Robots without any compared estimate."""
        return [name for name, robot in self.robots.items() if robot.compared == 0]

    @property
    def beliefs(self) -> dict[str, Estimate]:
        """The newest estimate of each robot, in the scene's order; stale if the robot has become silent."""
        return {name: as_of_now(self.latest[name], self.truth) for name in self.scene.robots if name in self.latest}

    @property
    def complete(self) -> bool:
        """Whether the estimates of all robots for the newest truth's block have arrived."""
        newest = self.truth
        if newest is None or self.silent or any(e.block < newest.block for e in self.latest.values()):
            return False
        return all(other.complete for other in self.beside.values())

    def receive(self, news: News) -> list[tuple[str, Estimate]]:
        """Process a received message; return what ``Pairing.receive`` does."""
        match news:
            case Truth():
                for record in (self, *self.beside.values()):
                    record._note_truth(news)
            case Estimate():
                self._note_estimate(news)
            case EstimateBeside(estimate=estimate) if estimate.estimator in self.beside:
                self.beside[estimate.estimator]._note_estimate(estimate)
        ready = self._pairing.receive(news)
        for name, estimate in ready:
            self.beside.get(name, self).robots[estimate.robot].compare(estimate)
        return ready

    def _note_truth(self, truth: Truth) -> None:
        """Note the truth of one more block, which is not paired yet."""
        if self.truth is None or load_ids(truth) != load_ids(self.truth):
            self.periods.append(LoadPeriod(loads_since(truth), truth))
        self.blocks += 1
        self.slips.follow(truth)
        if self.carried is not None:
            self.carried.add(truth)

    def _note_estimate(self, estimate: Estimate) -> None:
        """Note an estimate, and whether the estimator has changed: all robots change it at the same block."""
        self.latest[estimate.robot] = estimate
        since = estimate.time * estimate.block / (estimate.block + 1)
        newest = self.estimators[-1] if self.estimators else None
        if newest is None or (since > newest.since_s and estimate.estimator != newest.estimator):
            self.estimators.append(EstimatorUse(round(since, 9), estimate.estimator))


def loads_since(truth: Truth) -> float:
    """Return the time of the last load change [s]; the block's beginning, if the truth does not contain it."""
    return truth.time * truth.block / (truth.block + 1) if truth.loads_since is None else truth.loads_since


def load_ids(truth: Truth) -> list[int]:
    """Return the numbers of the loads on the payload; a load that leaks keeps its number."""
    return [load.id for load in truth.loads]


def as_of_now(estimate: Estimate, truth: Truth | None) -> Estimate:
    """Return the newest estimate of a robot, as stale if it is much older than the newest truth."""
    if truth is None or truth.block - estimate.block <= SILENT:
        return estimate
    reason = f"no estimate of {estimate.robot} since {estimate.time:.2f} s"
    return msgspec.structs.replace(estimate, status=Validity.STALE, reasons=[reason])
