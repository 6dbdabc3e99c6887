"""What a judge says of a recording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from coheft.estimation.batch.judge.cause import Cause
from coheft.estimation.geometry.spatial import Array


@dataclass(frozen=True, eq=False)
class Verdict:
    """What a judge says of a recording.

    Attributes:
        is_refuted: Whether the numbers are not to be trusted.
        cause: What is wrong: empty if nothing is.
        robot: Whose fault it is, if it is one robot's.
        value: What a cause's unknowns are, see ``Suspect.value``.
        ratio: By how many times residuals are larger than noise explains.
        margin: Gain over the second best cause.
        second: That cause.
        mass: The load's mass with the cause estimated along, and its standard deviation [kg]; None if it is not mended.
        channels: Of a clock: what of the robot's record is late.
        gravity: In all home frames (N, 3) [m/s²], as forces have it, if it is that what is wrong.
        words: All of this in a sentence; empty if nothing is wrong.
        hidden: What an accepted fit may hide: by cause, the covariance (10, 10) that it would add to ``theta`` in the
            body frame if nothing but this recording spoke against it.
    """

    is_refuted: bool
    cause: Cause | Literal[""] = ""
    robot: str | None = None
    value: tuple[float, ...] = ()
    ratio: float = 1.0
    margin: float = 0.0
    second: str = ""
    mass: tuple[float, float] | None = None
    channels: tuple[str, ...] = ("wrench",)
    gravity: Array | None = None
    words: str = ""
    hidden: tuple[tuple[Cause, Array], ...] = ()
