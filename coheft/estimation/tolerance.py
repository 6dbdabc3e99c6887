"""Tolerances of a robot's sensors: one standard deviation of each error that is constant during a run.

The model is ``measured(t) = (1 + gain + scale + cross-talk) R(mounting) exact(t - delay) + offset + noise`` for each
sensor of three axes, where ``exact`` is the true quantity at the sensor's place. The grasp frame is the frame of the
force and torque sensor, which therefore has neither mounting nor place errors. The delay of all sensors of a robot is
its clock's error; force and torque have an additional delay. With a compliant grasp all of them are displaced against
the load by ``compliance x force``, in the direction in which the robot pushes.
"""

from typing import Annotated, NamedTuple

import msgspec
import numpy as np
from msgspec import Meta

from coheft.estimation.geometry.spatial import CROSS_OF_AXES, Array

Deviation = Annotated[float, Meta(ge=0)]
_AXES = np.eye(3)
SENSORS = ("gyro", "velocity", "acceleration", "force", "torque")
"""Sensors in the order of a sample's columns, three each."""
MOTION_SENSORS = SENSORS[:3]
"""Those of the motion; the others measure the wrench."""
SENSOR_NAMES = dict(
    zip(SENSORS, ("gyro", "velocity sensor", "accelerometer", "force sensor", "torque sensor"), strict=True)
)
"""Names of sensors in texts."""
SHAPES = {
    "gain": _AXES[None],
    "scale": _AXES[:, :, None] * _AXES[:, None],
    "mounting": CROSS_OF_AXES,
    "cross_talk": np.abs(CROSS_OF_AXES),
}
"""Matrices ``E_k`` of proportional errors, with ``measured = exact + sum_k e_k E_k exact``."""
AXES, PAIRS = ("x", "y", "z"), ("yz", "zx", "xy")
"""Names of the axes of errors, and of the pairs of axes of cross-talk."""


class Proportional(NamedTuple):
    """An error that is proportional to the reading.

    Attributes:
        columns: Columns of the sensor in a sample.
        matrix: ``E_k``, shape (3, 3).
        deviation: Standard deviation of ``e_k``; for a mounting in rad.
    """

    columns: slice
    matrix: Array
    deviation: float


class SensorTolerance(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One standard deviation of each constant error, not a limit: one in 20 errors is more than twice as large. Errors
    differ from robot to robot.

    Attributes:
        gyro_offset: Offset of the angular velocity, each axis [rad/s].
        velocity_offset: Offset of the velocity, each axis [m/s].
        acceleration_offset: Offset of the acceleration, each axis [m/s²].
        force_offset: Offset of the force, each axis [N].
        torque_offset: Offset of the torque, each axis [N·m].
        force_gain: Relative error of the force, common to all axes.
        torque_gain: Relative error of the torque, common to all axes.
        gyro_scale: Relative error of the angular velocity, each axis.
        velocity_scale: Relative error of the velocity, each axis.
        acceleration_scale: Relative error of the acceleration, each axis.
        force_scale: Relative error of the force, each axis.
        torque_scale: Relative error of the torque, each axis.
        gyro_mounting_deg: Rotation of the gyro about each axis of the force and torque sensor [°].
        velocity_mounting_deg: Rotation of the velocity sensor, likewise [°].
        acceleration_mounting_deg: Rotation of the accelerometer, likewise [°].
        gyro_cross_talk: Share of one axis that another reads, each pair of axes.
        velocity_cross_talk: The same for the velocity.
        acceleration_cross_talk: The same for the acceleration.
        force_cross_talk: The same for the force.
        torque_cross_talk: The same for the torque.
        velocity_place: Position error of the velocity sensor relative to the force and torque sensor, each axis [m].
        acceleration_place: Position error of the accelerometer, likewise [m].
        clock: Offset of a robot's clock against the others [s].
        wrench_delay: Delay of a robot's force and torque against its other sensors [s].
        grasp_compliance: Displacement of a robot's hand against the load per force, alike in all directions [m/N].
    """

    gyro_offset: Deviation = 0.0
    velocity_offset: Deviation = 0.0
    acceleration_offset: Deviation = 0.0
    force_offset: Deviation = 0.0
    torque_offset: Deviation = 0.0
    force_gain: Deviation = 0.0
    torque_gain: Deviation = 0.0
    gyro_scale: Deviation = 0.0
    velocity_scale: Deviation = 0.0
    acceleration_scale: Deviation = 0.0
    force_scale: Deviation = 0.0
    torque_scale: Deviation = 0.0
    gyro_mounting_deg: Deviation = 0.0
    velocity_mounting_deg: Deviation = 0.0
    acceleration_mounting_deg: Deviation = 0.0
    gyro_cross_talk: Deviation = 0.0
    velocity_cross_talk: Deviation = 0.0
    acceleration_cross_talk: Deviation = 0.0
    force_cross_talk: Deviation = 0.0
    torque_cross_talk: Deviation = 0.0
    velocity_place: Deviation = 0.0
    acceleration_place: Deviation = 0.0
    clock: Deviation = 0.0
    wrench_delay: Deviation = 0.0
    grasp_compliance: Deviation = 0.0

    def offsets(self) -> Array:
        """Return the standard deviation of the offset of each column of a sample, shape (15,)."""
        each = (self.gyro_offset, self.velocity_offset, self.acceleration_offset, self.force_offset, self.torque_offset)
        return np.repeat(each, 3)

    def of(self, sensor: str, shape: str) -> float:
        """Return the deviation of a sensor's errors of one of ``SHAPES``, for a mounting in rad; 0 if it has no such
        errors.
        """
        if shape == "mounting":
            degrees: float = getattr(self, f"{sensor}_mounting_deg", 0.0)
            return float(np.radians(degrees))
        return getattr(self, f"{sensor}_{shape}", 0.0)

    def proportional(self) -> list[Proportional]:
        """Return all proportional errors with a deviation above 0."""
        found = []
        for place, sensor in enumerate(SENSORS):
            columns = slice(3 * place, 3 * place + 3)
            for shape, matrices in SHAPES.items():
                if (deviation := self.of(sensor, shape)) > 0.0:
                    found += [Proportional(columns, matrix, deviation) for matrix in matrices]
        return found


class SensorDrift(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Drift of constant errors, as random walks: the standard deviation of the change within a minute.

    Attributes:
        gyro: Drift of the gyro's offset, each axis [rad/s].
        acceleration: Drift of the accelerometer's offset, each axis [m/s²].
        force: Drift of the force sensor's offset, each axis [N].
        torque: Drift of the torque sensor's offset, each axis [N·m].
    """

    gyro: Deviation = 0.0
    acceleration: Deviation = 0.0
    force: Deviation = 0.0
    torque: Deviation = 0.0

    @property
    def is_any(self) -> bool:
        """Whether any sensor drifts."""
        return max(self.gyro, self.acceleration, self.force, self.torque) > 0.0

    def per_column(self) -> Array:
        """Return the drift of each column of a sample, shape (15,)."""
        return np.repeat([self.gyro, 0.0, self.acceleration, self.force, self.torque], 3)


INDUSTRIAL = SensorTolerance(
    gyro_offset=0.005,
    gyro_scale=0.005,
    gyro_mounting_deg=0.5,
    velocity_scale=0.005,
    velocity_mounting_deg=0.5,
    acceleration_offset=0.05,
    acceleration_scale=0.005,
    acceleration_mounting_deg=0.5,
    force_offset=1.0,
    force_scale=0.005,
    torque_offset=0.05,
    torque_scale=0.005,
    clock=0.001,
    wrench_delay=0.001,
)
"""Tolerances of a good industrial arm, with a force and torque sensor at its wrist and an IMU beside it."""
