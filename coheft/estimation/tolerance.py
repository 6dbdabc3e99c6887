"""How far a robot's sensors may be off, for as long as a run lasts: what a data sheet says.

The model is ``measured = (1 + gain) exact + offset + noise``.
"""

from __future__ import annotations

from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import FORCE, SAMPLE_SIZE, TORQUE

Deviation = Annotated[float, Meta(ge=0)]


class SensorTolerance(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Standard deviations of constant errors: of each axis of each robot an offset, of each of its sensors a gain.

    Attributes:
        gyro_offset: Of the angular velocity [rad/s].
        velocity_offset: Of the velocity [m/s].
        acceleration_offset: Of the acceleration [m/s²].
        force_offset: Of the force [N].
        torque_offset: Of the torque [N·m].
        force_gain: Of the force, relative, alike for all axes.
        torque_gain: Of the torque, relative, alike for all axes.
    """

    gyro_offset: Deviation = 0.0
    velocity_offset: Deviation = 0.0
    acceleration_offset: Deviation = 0.0
    force_offset: Deviation = 0.0
    torque_offset: Deviation = 0.0
    force_gain: Deviation = 0.0
    torque_gain: Deviation = 0.0

    def offsets(self) -> Array:
        """Of each column of a sample, shape (15,)."""
        each = (self.gyro_offset, self.velocity_offset, self.acceleration_offset, self.force_offset, self.torque_offset)
        return np.repeat(each, 3)

    def gains(self) -> Array:
        """Of each column of a sample, shape (15,); the three of a sensor have one gain in common."""
        gains = np.zeros(SAMPLE_SIZE)
        gains[FORCE], gains[TORQUE] = self.force_gain, self.torque_gain
        return gains
