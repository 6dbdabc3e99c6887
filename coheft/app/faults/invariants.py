"""Promises about every published estimate, checked after every block against the truth.

- **P1**: while an estimate is ``valid``, each of its numbers (mass, the centre of mass's three, the inertia's six, each
  neighbour's pose's six) is within five of its own standard deviations of the truth at its ``valid_block``; its
  covariances are positive; a body with such mass properties can exist.
- **P2**: nothing makes an agent fail. ``trial`` checks that harmless messages make no difference.

A change of the load cannot be known before it has an effect: a payload that belongs to less than ``GRACE`` after a
change is not checked, and nothing that belongs to less than ``GRACE_OF_SLIP`` after a slip is. Neither are agents that
lie or have lied, nor the poses of robots that do not hold the load.
"""

import math

import msgspec
import numpy as np

from coheft.app.faults.run import FaultyBlock
from coheft.app.faults.schedule import FaultSchedule, Lie, Release
from coheft.app.results.errors import payload_error, pose_error
from coheft.app.results.judge import Judge
from coheft.app.results.quantities import payload_exists
from coheft.estimation.geometry.spatial import Array
from coheft.wire.messages.structs import Estimate, Validity
from coheft.wire.messages.truth import Scene
from coheft.wire.scenario.borders import first_border

DEVIATIONS = 5.0
"""Largest error of a valid number, in its own standard deviations."""
GRACE = 0.3
"""Time after a change of the load from which a valid payload must be the new one [s]."""
GRACE_OF_SLIP = 1.5
"""The same after a slip of a grasp, also for poses [s]: a slip that is hardly visible takes about a second to show."""
_ROUNDING = 1e-9
_AXES = ("xx", "yy", "zz", "xy", "xz", "yz")
_PAYLOAD = ("mass", *(f"centre of mass {axis}" for axis in "xyz"), *(f"inertia {axes}" for axes in _AXES))
_POSE = (*(f"rotation {axis}" for axis in "xyz"), *(f"position {axis}" for axis in "xyz"))


class Violation(msgspec.Struct, frozen=True):
    """A broken promise.

    It was first broken in the block that ended at ``time`` [s]; the ``size`` of P1 is the largest error in standard
    deviations, that of P3 the time it took [s].
    """

    promise: str
    time: float
    robot: str
    what: str
    size: float = 0.0


class Watch:
    """Checks everything that a team publishes, see the module.

    ``off_for`` is the longest time for which a robot has reported wrong numbers as valid [s]; None if it never did.
    """

    def __init__(self, schedule: FaultSchedule, scene: Scene) -> None:
        scenario = schedule.scenario
        self._judge = Judge(scene)
        self._seen = 0
        self._block_duration = scenario.block_duration
        self._grace = math.ceil(GRACE / scenario.block_duration)
        self._changes = [first_border(change.at, scenario.block_duration) for change in scenario.load_changes]
        self._slips = [slip.at for slip in scenario.slips]
        self._releases = [fault for fault in schedule.faults if isinstance(fault, Release)]
        lies = sorted((fault for fault in schedule.faults if isinstance(fault, Lie)), key=lambda lie: -lie.start)
        self._lies = {lie.robot: lie.start for lie in lies}  # the first lie of each robot
        self._found: dict[tuple[str, str, str], Violation] = {}
        self._off_since: dict[str, float] = {}
        self._is_off = False
        self.off_for: float | None = None

    @property
    def violations(self) -> list[Violation]:
        """Broken promises, each with its first time and its largest size, in order of time."""
        return sorted(self._found.values(), key=lambda violation: violation.time)

    def check(self, block: FaultyBlock) -> None:
        """Check all estimates that were published after a block."""
        self._seen += 1
        self._judge.add(block.truth, remember=self._seen)
        for robot, error in block.crashes.items():
            self._report("P2", block.truth.time, robot, f"raised {type(error).__name__}", str(error))
        for robot, outbox in block.outboxes.items():
            estimate = outbox.estimate
            if estimate is None:
                continue
            since, self._is_off = self._off_since.pop(robot, estimate.time), False
            times = (self._block_duration * estimate.valid_block, estimate.time)
            has_just_slipped = any(slip <= time < slip + GRACE_OF_SLIP for slip in self._slips for time in times)
            is_judged = self._lies.get(robot, math.inf) > estimate.time and not has_just_slipped
            if estimate.status is Validity.VALID and is_judged:
                self._check_payload(estimate)
                self._check_poses(estimate)
            if self._is_off:
                self._off_since[robot] = since
                self.off_for = max(self.off_for or 0.0, estimate.time - since)

    def _check_payload(self, estimate: Estimate) -> None:
        robot, payload, block = estimate.robot, estimate.payload, estimate.valid_block
        if payload is None or not 0 <= block < self._seen:
            self._report("P1", estimate.time, robot, "is valid without a payload", f"{payload=}, {block=}")
            return
        if not payload_exists(payload):
            self._report("P1", estimate.time, robot, "payload cannot exist", "")
        if any(change <= block < change + self._grace for change in self._changes):
            return
        error = payload_error(self._judge.payload(robot, block), payload)
        self._compare(estimate, "payload", _PAYLOAD[: len(error)], error, payload.covariance)

    def _check_poses(self, estimate: Estimate) -> None:
        time = estimate.valid_block * self._block_duration
        for other, pose in estimate.poses.items():
            if any(release.robot in (other, estimate.robot) and release.is_active(time) for release in self._releases):
                continue
            true = self._judge.relative_pose(estimate.robot, other, estimate.block)
            self._compare(estimate, f"pose of {other}", _POSE, pose_error(true, pose), pose.covariance)

    def _compare(self, estimate: Estimate, what: str, names: tuple[str, ...], error: Array, covariance: Array) -> None:
        """Compare errors (n,) with their covariance (n, n)."""
        variances = np.diagonal(covariance)
        if not (np.isfinite(covariance).all() and np.isfinite(error).all() and (variances > 0.0).all()):
            self._report("P1", estimate.time, estimate.robot, f"{what}: no number, or no covariance", f"{variances}")
            return
        deviations = np.sqrt(variances)
        if np.linalg.eigvalsh(covariance / np.outer(deviations, deviations))[0] < -_ROUNDING:
            self._report("P1", estimate.time, estimate.robot, f"{what}: covariance not positive", "")
        off = np.abs(error) / deviations
        worst = int(np.argmax(off))
        if off[worst] > DEVIATIONS:
            self._is_off = True
            text = f"{names[worst]} off by {abs(error[worst]):.3g}, {off[worst]:.1f} of its standard deviations"
            self._report("P1", estimate.time, estimate.robot, what, text, float(off[worst]))

    def _report(self, promise: str, time: float, robot: str, what: str, details: str, size: float = 0.0) -> None:
        known = self._found.get((promise, robot, what))
        if known is None:
            self._found[promise, robot, what] = Violation(promise, time, robot, f"{what}: {details}".rstrip(": "), size)
        elif size > known.size:
            self._found[promise, robot, what] = msgspec.structs.replace(known, size=size)
