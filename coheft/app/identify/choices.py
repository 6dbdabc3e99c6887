"""What a user may choose about an identification; nothing heavy is loaded for it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Method = Literal["batch", "instruments", "pose", "likelihood", "static"]


@dataclass(frozen=True)
class Bounds:
    """How wrong robots may be that are not calibrated: errors are anywhere within plus or minus these.

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
