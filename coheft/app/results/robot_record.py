"""The record of one robot's estimates: each is compared with the truth when it arrives, and then dropped."""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, field

import msgspec
import numpy as np

from coheft.app.results.judge import Judge, RobotReport
from coheft.estimation.geometry.spatial import Array
from coheft.wire.messages.structs import Estimate
from coheft.wire.messages.truth import Truth

LASTING = 1.0
"""Time near the truth after which a robot has recovered, whatever happens later [s]; it might just have passed it."""
_FORCE_TORQUE = (slice(0, 3), slice(3, 6))
_ROUNDING = 1e-9


class HistoryPoint(msgspec.Struct, frozen=True):
    """One robot's errors at one moment; None where it had no estimate."""

    time_s: float
    mass_error_pct: float | None
    com_error_mm: float | None
    inertia_error_pct: float | None


@dataclass(eq=False)
class LoadPeriod:
    """The period from one load change to the next.

    Attributes:
        start: Start of its first block [s].
        truth: Truth of that block, or of the first one after it that was received.
        before: Each robot's ``RobotReport`` just before, as MessagePack: an hour may have hundreds of changes, and
            objects would take four times as much memory.
        noticed: When each robot first noticed a change in this period [s].
        recovered: Since when all of a robot's estimates have been near the truth [s]; None while they are not. It no
            longer changes once the robot has recovered, or has restarted.
    """

    start: float
    truth: Truth
    before: dict[str, bytes] = field(default_factory=dict)
    noticed: dict[str, float] = field(default_factory=dict)
    recovered: dict[str, float | None] = field(default_factory=dict)

    def believed_before(self, robot: str) -> RobotReport | None:
        """Return a robot's estimate just before the period; None if there was none."""
        before = self.before.get(robot)
        return None if before is None else msgspec.msgpack.decode(before, type=RobotReport)


class RobotRecord:
    """Compares one robot's estimates with the truth; its reactions to changes of the load are kept in the periods.

    Attributes:
        wrench_errors: Sums of squares of the errors of total force and torque in phase ``inertia``, shape (2,).
        wrench_totals: Sums of squares of the true total force and torque, shape (2,).
    """

    def __init__(self, judge: Judge, periods: Sequence[LoadPeriod], *, with_history: bool) -> None:
        self.compared = 0
        self.wrench_errors: Array = np.zeros(2)
        self.wrench_totals: Array = np.zeros(2)
        self.history: list[HistoryPoint] = []
        self._judge = judge
        self._periods = periods
        self._with_history = with_history
        self._last: Estimate | None = None
        self._converged_at: float | None = None
        self._period = 0
        self._has_recovered = False

    @property
    def report(self) -> RobotReport | None:
        """The last estimate compared with the truth; None if there is none."""
        return None if self._last is None else self._judge.robot(self._last, self._converged_at)

    def compare(self, estimate: Estimate) -> None:
        """Add the next estimate, whose truth has arrived."""
        self._follow_load(estimate)
        if self._last is not None and estimate.estimator != self._last.estimator:
            self._converged_at = None  # it has discarded all that it knew
        self.compared += 1
        self._last = estimate
        if estimate.is_converged and self._converged_at is None:
            self._converged_at = estimate.time
        self._compare_wrench(estimate)
        if self._with_history:
            self._add_history(estimate)

    def _follow_load(self, estimate: Estimate) -> None:
        name, periods = estimate.robot, self._periods
        while self._period + 1 < len(periods) and periods[self._period + 1].truth.block <= estimate.block:
            self._period += 1
            self._has_recovered = False
            if (before := self.report) is not None:
                periods[self._period].before[name] = msgspec.msgpack.encode(before)
        self._follow_recovery(estimate, periods[self._period].recovered)
        for notice in estimate.load_changes:
            begun = bisect_left(periods, notice.noticed_at, key=lambda period: period.start)
            noticed = periods[max(0, begun - 1)].noticed
            noticed[name] = min(notice.noticed_at, noticed.get(name, notice.noticed_at))

    def _follow_recovery(self, estimate: Estimate, recovered: dict[str, float | None]) -> None:
        """Note since when the robot has been near the truth, until it has recovered."""
        name = estimate.robot
        since, last = recovered.get(name), self._last
        if since is not None and last is not None:  # an estimate that is missing after a restart is not wrong
            has_forgotten = last.payload is not None and estimate.payload is None
            self._has_recovered |= has_forgotten or estimate.estimator != last.estimator
        if self._has_recovered:
            return
        if not self._judge.recovered(estimate):
            recovered[name] = None
        elif since is None:
            recovered[name] = estimate.time
        else:
            self._has_recovered = estimate.time - since >= LASTING - _ROUNDING

    def _compare_wrench(self, estimate: Estimate) -> None:
        truth = self._judge.total_wrench(estimate.robot, estimate.total_block)
        if estimate.phase == "inertia" and truth is not None:
            error = estimate.total_wrench - truth
            self.wrench_errors += [error[part] @ error[part] for part in _FORCE_TORQUE]
            self.wrench_totals += [truth[part] @ truth[part] for part in _FORCE_TORQUE]

    def _add_history(self, estimate: Estimate) -> None:
        """Add a point if a second has passed since the last one."""
        last = self.history[-1].time_s if self.history else 0.0
        if int(estimate.time + 1e-9) > int(last + 1e-9):
            robot = self._judge.robot(estimate)
            self.history.append(
                HistoryPoint(estimate.time, robot.mass.error_pct, robot.com.error_mm, robot.inertia.error_pct)
            )
