"""The result of identification by any method, and what no robots and no load can have: something is wrong then."""

from collections.abc import Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from coheft.estimation.batch.holds import Holds
from coheft.estimation.batch.judge.evidence import Evidence
from coheft.estimation.batch.judge.verdict import Cause, Verdict
from coheft.estimation.batch.pairs import LoopError, TeamPoses
from coheft.estimation.batch.payload import Payload
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.rigid_body.unobservable import middle_and_size

_FAR = 10.0
"""Distance from all possible bodies, in standard deviations, that noise does not explain."""
_FARTHEST = 20.0
"""No load is longer [m]: lengths must be in another unit."""
_DENSEST = 2.3e4
"""No material is denser [kg/m³]."""
_METRES = "Are all lengths in metres, moments in N·m, and angular velocities in rad/s?"


class CalibrationFinding(msgspec.Struct, frozen=True):
    """One calibration error of a robot.

    Attributes:
        robot: Name of the robot.
        what: The error: a zero or scale of a gimbal's angle ``a``, ``b`` or ``c``, the scale of positions or forces, or
            the offset of forces along an axis of the robot's home frame.
        unit: Unit of the numbers: ``deg``, ``%`` or ``N``.
        value: By how much what the robot measures is too large; for scales as a share of it.
        std: Standard deviation of the value.
        std_before: Standard deviation that was known before anything was measured.
        seen: Whether the recording has reduced the standard deviation to less than half.
    """

    robot: str
    what: str
    unit: str
    value: float
    std: float
    std_before: float
    seen: bool


@dataclass(frozen=True)
class HiddenError:
    """Additional standard deviation of a number by the worst fault that the recording would not show."""

    cause: str
    std: float


@dataclass(frozen=True, eq=False)
class Identification:
    """The load, and where the robots hold it, as one method has found them in a recording.

    Attributes:
        method: Name of the method.
        names: Names of the robots; all quantities are given in the first one's grasp frame.
        team: Poses of all grasp frames.
        payload: Mass properties of the load.
        time: Times of the residuals, shape (n,) [s].
        residual: Residuals of the total wrench (force, torque), or of the torque only, shape (n, 6) or (n, 3).
        loops: By how much loops of pairs did not close before they were fitted together.
        holds: Measurements at rest; None if they were not used.
        calibration: Calibration errors of the robots; empty if they were not estimated.
        remarks: Remarks for the user, as sentences.
        suspicions: Contradictions within the method's own fit, as sentences.
        verdict: Verdict on the recording; None if it could not be judged.
        not_judged: Why it could not be judged; empty if it could.
        hidden: For each of ``(m, h, J)``, the worst fault that would not show; empty if not judged, or refuted.
        evidence: Input of the judge, if it has been computed already.
        unsuitable: Why another method suits better, as a sentence without a full stop; empty if none does.
    """

    method: str
    names: tuple[str, ...]
    team: TeamPoses
    payload: Payload
    time: Array
    residual: Array
    loops: tuple[LoopError, ...] = ()
    holds: Holds | None = None
    calibration: tuple[CalibrationFinding, ...] = ()
    remarks: tuple[str, ...] = ()
    suspicions: tuple[str, ...] = ()
    verdict: Verdict | None = None
    not_judged: str = ""
    hidden: tuple[HiddenError, ...] = ()
    evidence: Evidence | None = None
    unsuitable: str = ""

    @property
    def doubts(self) -> tuple[str, ...]:
        """All contradictions, as sentences; if there are any, none of the numbers is to be trusted."""
        if self.is_explained:
            assert self.verdict is not None
            return (self.verdict.words,)
        refuted = (self.verdict.words,) if self.verdict is not None and self.verdict.is_refuted else ()
        return (*refuted, *self.suspicions, *_doubts_about(self.names, self.team, self.payload))

    @property
    def is_explained(self) -> bool:
        """Whether one fault explains all contradictions."""
        return self.verdict is not None and self.verdict.is_refuted and self.verdict.cause != Cause.UNKNOWN


def unsettled(team: TeamPoses) -> tuple[str, ...]:
    """Say that a fit of poses did not converge; poses that are not observable need not."""
    if team.is_settled or not team.is_observable:
        return ()
    return (
        "The fit of the poses did not converge. Are poses and twists those of grasp frames, and do all clocks agree? "
        "Did a robot let go (--from and --to choose a part)?",
    )


def solid_density(payload: Payload, slack: float) -> float:
    """Density of the homogeneous ellipsoid with these mass properties [kg/m³]: any other body is denser somewhere.

    The inertia, which is known, may be larger by ``slack`` standard deviations.
    """
    mass, tensor = payload.inertia.mass, payload.inertia.tensor
    second = np.maximum(0.5 * np.trace(tensor) - np.linalg.eigvalsh(tensor), 0.0) + slack * payload.std[4:].max()
    volume = 4.0 / 3.0 * np.pi * np.sqrt(np.prod(5.0 * second / mass))
    return float(mass / max(volume, 1e-300))


def _doubts_about(names: Sequence[str], team: TeamPoses, payload: Payload) -> tuple[str, ...]:
    """Contradictions in what was identified, as sentences."""
    doubts = []
    relative = [team.relative(0, k) for k in range(1, len(names))]
    far = {
        name: distance
        for name, pose in zip(names[1:], relative, strict=True)
        if not pose.unobservable and (distance := float(np.linalg.norm(pose.pose.translation))) > _FARTHEST
    }
    if far:
        distances = ", ".join(f"{name} {distance:.0f} m" for name, distance in far.items())
        doubts.append(f"Robots that hold one load would be too far from {names[0]}: {distances}. {_METRES}")
    middle, _ = middle_and_size(team.poses)
    away = float(np.linalg.norm(payload.inertia.com - middle))
    if away > _FARTHEST and payload.is_seen("com") and not far:
        doubts.append(f"The centre of mass would be {away:.0f} m from where robots hold the load. {_METRES}")
    density = solid_density(payload, _FAR) if payload.is_seen("inertia") else 0.0
    if density > _DENSEST and not doubts:
        doubts.append(
            f"Mass and moments of inertia would be those of something of at least {density:.3g} kg/m³, denser than any "
            f"material: are forces in newtons?"
        )
    if payload.deviations_off > _FAR and payload.is_seen("inertia") and team.is_observable:
        doubts.append(
            f"The mass properties are physically impossible, by {payload.deviations_off:.0f} of their standard "
            f"deviations. Are forces and moments those on the load, in the axes of the grasp frame, and do all clocks "
            f"agree? Did the load change (--from and --to choose a part)? Are the robots badly calibrated (--method "
            f"pose --calibrate, which needs poses)?"
        )
    return tuple(doubts)
