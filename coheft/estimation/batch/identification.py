"""What any method says of a recording."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from coheft.estimation.batch.doubts import doubts_about
from coheft.estimation.batch.holds import Holds
from coheft.estimation.batch.judge.cause import Cause
from coheft.estimation.batch.judge.evidence import Evidence
from coheft.estimation.batch.judge.verdict import Verdict
from coheft.estimation.batch.loop_closure import LoopError
from coheft.estimation.batch.payload import Payload
from coheft.estimation.batch.team_poses import TeamPoses
from coheft.estimation.geometry.spatial import Array


@dataclass(frozen=True, eq=False)
class CalibrationFinding:
    """One thing that may be wrong with a robot.

    Attributes:
        robot: Whose.
        what: Which.
        unit: Of the numbers.
        value: What was found.
        std: Its standard deviation.
        before: Its standard deviation before anything was measured.
    """

    robot: str
    what: str
    unit: str
    value: float
    std: float
    before: float

    @property
    def is_seen(self) -> bool:
        """Whether the recording said anything about it worth mentioning."""
        return self.std < 0.5 * self.before


@dataclass(frozen=True)
class HiddenError:
    """What a number may be off although all fits: the worst cause, and the standard deviation that it would have."""

    cause: str
    std: float


@dataclass(frozen=True, eq=False)
class Identification:
    """What a recording says.

    Attributes:
        method: How it was found.
        names: Of the robots; the first one's grasp frame is what all is given in.
        team: Poses of all grasp frames.
        payload: Mass properties.
        loops: Failures of loops of pairs to close, before they were made to.
        holds: What was measured at rest; None if not used.
        calibration: What may be wrong with the robots.
        remarks: What the reader should know, in words.
        suspicions: What in the method's own fit speaks against it, in words.
        verdict: Of a judge who asks whether forces are those of one rigid body; None if it could not be asked.
        hidden: For each of ``(m, h, J)``, what may be wrong without being seen; empty if not judged, or refuted.
        time: Of the residuals, shape (n,) [s].
        residual: Of the total wrench (force, torque), or of the torque alone, shape (n, 6) or (n, 3).
        evidence: What a judge looks at, where the method has found it already.
    """

    method: str
    names: tuple[str, ...]
    team: TeamPoses
    payload: Payload
    loops: tuple[LoopError, ...] = ()
    holds: Holds | None = None
    calibration: tuple[CalibrationFinding, ...] = ()
    remarks: tuple[str, ...] = ()
    suspicions: tuple[str, ...] = ()
    verdict: Verdict | None = None
    hidden: tuple[HiddenError, ...] = ()
    time: Array = field(default_factory=lambda: np.zeros(0))
    residual: Array = field(default_factory=lambda: np.zeros((0, 3)))
    evidence: Evidence | None = None

    @property
    def doubts(self) -> tuple[str, ...]:
        """What speaks against all of it, in words: then none of the numbers is to be trusted."""
        if self.is_explained:
            assert self.verdict is not None
            return (self.verdict.words,)
        refuted = (self.verdict.words,) if self.verdict is not None and self.verdict.is_refuted else ()
        return (*refuted, *self.suspicions, *doubts_about(self.names, self.team, self.payload))

    @property
    def is_explained(self) -> bool:
        """Whether a cause was named for what does not fit: then all else that is odd comes of it."""
        return self.verdict is not None and self.verdict.is_refuted and self.verdict.cause != Cause.UNKNOWN
