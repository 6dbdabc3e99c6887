"""Effects of single constant sensor errors on exact readings, for the Cramér-Rao bound.

They are computed sample by sample, independently of the estimator, so that each can check the other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from coheft.estimation.geometry.body_motion import BODY_ALPHA, grasp_derivatives, grasp_measurements
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.measurement import ACCELERATION, GYRO, VELOCITY, WRENCH
from coheft.estimation.tolerance import Proportional, SensorTolerance


class Readings(NamedTuple):
    """Exact readings of one robot's sensors.

    Attributes:
        exact: The readings, shape (n, 15).
        rates: Their rates of change, shape (n, 15).
        alpha: Angular acceleration at the robot's frame, shape (n, 3).
        flexing: First and second derivative of the force in axes that do not rotate, shape (n, 6).
    """

    exact: Array
    rates: Array
    alpha: Array
    flexing: Array

    @staticmethod
    def at(
        pose: Pose, motion: Array, wrenches: Array, motion_rates: Array, wrench_rates: Array, flexing: Array
    ) -> Readings:
        """Make the readings of a robot with this pose in the body frame; shapes as in ``JointInformation.of``."""
        kinematics = grasp_measurements(pose, motion)
        rates = (grasp_derivatives(pose, motion)[1] @ motion_rates[..., None])[..., 0]
        alpha = motion[:, BODY_ALPHA] @ pose.rotation
        return Readings(np.hstack([kinematics, wrenches]), np.hstack([rates, wrench_rates]), alpha, flexing)


class SensorError(NamedTuple):
    """One unknown constant error of a robot's sensors, and the effect of a unit of it on the readings, shape (n,
    15).
    """

    robot: int
    deviation: float
    is_of_wrench: bool
    effect: Callable[[Readings], Array]


def sensor_errors(tolerances: Sequence[SensorTolerance]) -> list[SensorError]:
    """Return all errors with a tolerance, of robots with these, those of kinematics first."""
    errors = [error for robot, tolerance in enumerate(tolerances) for error in _errors_of(robot, tolerance)]
    return sorted(errors, key=lambda error: error.is_of_wrench)


def _errors_of(robot: int, tolerance: SensorTolerance) -> list[SensorError]:
    kinds: list[tuple[float, bool, Callable[[Readings], Array]]] = []
    for column, deviation in enumerate(tolerance.offsets()):
        kinds.append((deviation, column >= WRENCH.start, partial(_offset, column)))
    for each in tolerance.proportional():
        kinds.append((each.deviation, each.columns.start >= WRENCH.start, partial(_proportional, each)))
    for axis in np.eye(3):
        kinds.append((tolerance.velocity_place, False, partial(_velocity_elsewhere, axis)))
        kinds.append((tolerance.acceleration_place, False, partial(_acceleration_elsewhere, axis)))
    kinds.append((tolerance.grasp_compliance, False, _compliant))
    kinds.append((tolerance.clock, False, partial(_late, slice(None))))
    kinds.append((tolerance.wrench_delay, True, partial(_late, WRENCH)))
    return [SensorError(robot, *kind) for kind in kinds if kind[0] > 0.0]


def _offset(column: int, readings: Readings) -> Array:
    result = np.zeros_like(readings.exact)
    result[:, column] = 1.0
    return result


def _proportional(error: Proportional, readings: Readings) -> Array:
    result = np.zeros_like(readings.exact)
    result[:, error.columns] = readings.exact[:, error.columns] @ error.matrix.T
    return result


def _velocity_elsewhere(place: Array, readings: Readings) -> Array:
    result = np.zeros_like(readings.exact)
    result[:, VELOCITY] = np.cross(readings.exact[:, GYRO], place)
    return result


def _acceleration_elsewhere(place: Array, readings: Readings) -> Array:
    w, result = readings.exact[:, GYRO], np.zeros_like(readings.exact)
    result[:, ACCELERATION] = np.cross(readings.alpha, place) + np.cross(w, np.cross(w, place))
    return result


def _compliant(readings: Readings) -> Array:
    result = np.zeros_like(readings.exact)
    result[:, VELOCITY], result[:, ACCELERATION] = readings.flexing[:, :3], readings.flexing[:, 3:]
    return result


def _late(columns: slice, readings: Readings) -> Array:
    result = np.zeros_like(readings.exact)
    result[:, columns] = -readings.rates[:, columns]
    return result
