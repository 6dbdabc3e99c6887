"""What a judge says of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np

from coheft.estimation.batch.judge.cause import Cause
from coheft.estimation.batch.judge.suspects import Suspect
from coheft.estimation.batch.judge.wrench_misfit import BODY_NUMBERS, Fit
from coheft.estimation.geometry.spatial import Array

_HIDING = (Cause.OFFSET, Cause.LEVER, Cause.SCALE, Cause.FORCE_SCALE, Cause.CLOCK, Cause.GRAVITY)
"""What sensors may well have without its being noticed."""


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

    @classmethod
    def accepted(cls, plain: Fit, suspects: Sequence[Suspect], assumed: str | None) -> Self:
        """Nothing speaks against the fit: what is not significant biases it by little more than it makes uncertain.

        So does a cause that was assumed, and taken out with its own uncertainty.
        """
        known = plain.covariance[:BODY_NUMBERS, :BODY_NUMBERS]
        hidden = tuple(
            (suspect.cause, suspect.fit.covariance[:BODY_NUMBERS, :BODY_NUMBERS] - known)
            for suspect in suspects
            if (suspect.cause in _HIDING or suspect.cause == assumed) and suspect.gain > -np.inf
        )
        return cls(is_refuted=False, hidden=hidden)
