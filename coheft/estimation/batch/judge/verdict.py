"""The verdict on a recording: whether one rigid body explains it, and if not, which fault does."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

from coheft.estimation.geometry.spatial import Array


class Cause(StrEnum):
    """Faults that a recording may have; reports contain these names, and ``--assume`` takes them."""

    OFFSET = "offset"
    LEVER = "lever"
    SCALE = "scale"
    FORCE_SCALE = "force scale"
    MOMENT_SCALE = "moment scale"
    AXIS_SCALE = "axis scale"
    BASE_AXES = "base axes"
    HOME_MOMENTS = "home moments"
    TURNED = "sensor turned"
    EXCHANGED = "forces for moments"
    SWAPPED = "robots swapped"
    COMPENSATED = "weight compensated"
    CLOCK = "clock"
    TIME = "time scale"
    GRAVITY = "gravity"
    LOAD_CHANGE = "load change"
    OFFSET_JUMP = "offset jump"
    DRIFT = "drift"
    NOT_LEVEL = "homes not level"
    INVERSE = "inverse poses"
    LENGTH_SCALE = "length scale"
    SLIP = "slip"
    DEAD = "sensor dead"
    MOTION = "motion sensor"
    UNKNOWN = "unknown"
    """No single fault explains the recording."""


ALL = "all robots"


@dataclass(frozen=True, eq=False)
class Verdict:
    """The verdict on a recording.

    Attributes:
        cause: The fault; empty if none was found.
        robot: The robot that has it; None if all have it, or if it is not known which one. With ``rivals``, the
            likeliest.
        value: The fault's parameters, see ``Suspect.value``.
        words: The verdict as a sentence; empty if no fault was found.
        ratio: Size of the residuals, in multiples of what noise explains.
        margin: How much likelier the fault is than the second likeliest, see ``Suspect.gain``.
        second: The second likeliest fault.
        mass: Mass of the load with the fault estimated along, and its standard deviation [kg]; None if the fault
            cannot be estimated.
        is_open: Whether several corrections are equally likely, so that none is made: either of two robots may be at
            fault, or either all forces or all moments are in another unit, or a motion that repeats itself is late.
        channels: Channels of the robot that are late, if the fault is a clock's.
        rivals: Others that are nearly as likely to have the fault: names of robots, or ``ALL``.
        gravity: Gravity in all home frames according to the forces, shape (N, 3) [m/s²], if its direction is the fault.
        hidden: What may be wrong without being noticed, if no fault was found: by fault, the covariance (10, 10) that
            it would add to ``theta`` in the body frame.
        corrections: Covariances (10, 10) that corrections add to ``theta`` in the body frame: those of faults that were
            assumed, if no fault is left.
        remark: What is unusual but no fault, as a sentence; empty if nothing is.
    """

    cause: Cause | Literal[""] = ""
    robot: str | None = None
    value: tuple[float, ...] = ()
    words: str = ""
    ratio: float = 1.0
    margin: float = 0.0
    second: str = ""
    mass: tuple[float, float] | None = None
    is_open: bool = False
    channels: tuple[str, ...] = ("wrench",)
    rivals: tuple[str, ...] = ()
    gravity: Array | None = None
    hidden: tuple[tuple[Cause, Array], ...] = ()
    corrections: tuple[Array, ...] = ()
    remark: str = ""

    @property
    def is_refuted(self) -> bool:
        """Whether a fault was found, so that the estimate is not to be trusted."""
        return self.cause != ""

    @property
    def candidates(self) -> tuple[str, ...]:
        """Those that may have the fault: names of robots, or ``ALL``."""
        return (self.robot or ALL, *self.rivals)
