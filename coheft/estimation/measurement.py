"""Measurements of one robot in its own grasp frame, in blocks of consecutive samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from coheft.estimation.geometry.spatial import Array

GYRO = slice(0, 3)
VELOCITY = slice(3, 6)
ACCELERATION = slice(6, 9)
FORCE = slice(9, 12)
TORQUE = slice(12, 15)
TWIST = slice(0, 6)
KINEMATICS_SIZE = 9
KINEMATICS = slice(0, KINEMATICS_SIZE)
WRENCH = slice(9, 15)
SAMPLE_SIZE = 15

Positive = Annotated[float, Meta(gt=0)]


class SensorNoise(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Standard deviation of each sensor's white noise, per axis and sample.

    Attributes:
        gyro: Noise of the angular velocity [rad/s].
        velocity: Noise of the velocity of the frame's origin [m/s].
        acceleration: Noise of the proper acceleration [m/s²].
        force: Noise of the force on the payload [N].
        torque: Noise of the torque on the payload about the frame's origin [N·m].
    """

    gyro: Positive = 0.005
    velocity: Positive = 0.01
    acceleration: Positive = 0.05
    force: Positive = 0.3
    torque: Positive = 0.03

    def per_column(self) -> Array:
        """Return the standard deviation of each column of a sample, shape (15,)."""
        each = (self.gyro, self.velocity, self.acceleration, self.force, self.torque)
        return np.array([deviation for deviation in each for _ in range(3)])

    def scaled(self, factor: float) -> SensorNoise:
        """Return the noise multiplied by ``factor``."""
        return SensorNoise(*(factor * getattr(self, name) for name in self.__struct_fields__))


@dataclass(frozen=True, eq=False)
class MeasurementBlock:
    """Consecutive samples of one robot's sensors, all in its own grasp frame ``F_i``.

    Attributes:
        index: Index of the block since the start of the run; sample b of it is sample ``index * B + b``.
        samples: Shape (B, 15): gyro ``w`` [rad/s], velocity of the origin ``v`` [m/s], proper acceleration ``a``
            [m/s²] (what an accelerometer reads), force ``f`` [N] and torque ``t`` [N·m] on the payload.
    """

    index: int
    samples: Array
