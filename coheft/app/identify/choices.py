"""Options of an identification; this module imports nothing heavy."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

Method = Literal["batch", "instruments", "pose", "likelihood", "static"]


@dataclass(frozen=True)
class Bounds:
    """Bounds of calibration errors, which are uniformly distributed within plus or minus these.

    Attributes:
        misalignment_deg: With --calibrate: how far the gimbal's zero may be off, about any axis [degrees].
        angle_scale: With --calibrate: how far the scale of each gimbal angle may be off, as a share of it.
        position_scale: With --calibrate: the same for the position.
        force_scale: With --calibrate: the same for the force.
        force_offset: With --calibrate: constant error of each axis of the force [N].
    """

    misalignment_deg: float = 1.0
    angle_scale: float = 0.01
    position_scale: float = 0.03
    force_scale: float = 0.01
    force_offset: float = 0.5


@dataclass(frozen=True, kw_only=True)
class Options:
    """How to evaluate a recording; ``coheft.identify`` describes them, ``coheft identify`` has the same names."""

    method: Method | None = None
    calibrate: bool = False
    bounds: Bounds | None = None
    from_: float | None = None
    to: float | None = None
    cutoff: float | None = None
    topics: tuple[str, ...] = ()
    holds: Path | None = None
    assume: str | None = None
