"""The result of identification by any method."""

from dataclasses import dataclass

import msgspec

from coheft.estimation.batch.doubts import doubts_about
from coheft.estimation.batch.holds import Holds
from coheft.estimation.batch.judge.evidence import Evidence
from coheft.estimation.batch.judge.verdict import Cause, Verdict
from coheft.estimation.batch.pairs import LoopError
from coheft.estimation.batch.payload import Payload
from coheft.estimation.batch.team_poses import TeamPoses
from coheft.estimation.geometry.spatial import Array


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
        return (*refuted, *self.suspicions, *doubts_about(self.names, self.team, self.payload))

    @property
    def is_explained(self) -> bool:
        """Whether one fault explains all contradictions."""
        return self.verdict is not None and self.verdict.is_refuted and self.verdict.cause != Cause.UNKNOWN
