"""The unknowns of a fit, and a value of all of them.

    unknowns = (pose 6, eta q) of each robot, one robot after another, then gyro offset 3, wrench offset 6, theta 10

All poses are in one body frame that the estimating robot chooses: one in which the pose of one robot, the anchor, never
changes. A pose is perturbed by ``(rotation, translation)`` in the axes of the body frame: ``R <- exp(rotation) R``,
``p <- p + translation``. ``theta = (m, m h, I_o)`` is about the origin of the body frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from coheft.estimation.geometry.body_motion import perturbation_between
from coheft.estimation.geometry.spatial import Array, Pose, rotation_exp
from coheft.estimation.moments.sensor_errors import SensorErrors

Indices = npt.NDArray[np.intp]
Flags = npt.NDArray[np.bool_]
POSE_SIZE = 6
OFFSET, THETA, LOAD_SIZE = slice(0, 6), slice(6, 16), 16
"""Slices of a load ``(wrench offset, theta)``."""


class Unknowns:
    """Indices of all unknowns of a team.

    Args:
        count: Number of robots.
        errors: Declared errors of their sensors.

    Attributes:
        count, errors: As given.
        own: Number of unknowns of one robot.
        motion_size, size: Number of unknowns that the motion depends on, and of all of them, ``u``.
        poses: Indices of each robot's pose, shape (N, 6).
        eta: Indices of each robot's sensor errors, shape (N, q).
        gyros, offset, theta, load: Slices of the team's common unknowns; ``load`` is ``offset`` and ``theta``.
    """

    def __init__(self, count: int, errors: SensorErrors) -> None:
        self.count, self.errors, self.own = count, errors, POSE_SIZE + errors.count
        ends = (count * self.own + np.cumsum([0, 3, 6, 10])).tolist()
        self.gyros, self.offset, self.theta = (slice(first, end) for first, end in pairwise(ends))
        self.load, self.motion_size, self.size = slice(self.offset.start, self.theta.stop), int(ends[1]), int(ends[-1])
        by_robot: Indices = np.arange(count * self.own).reshape(count, self.own)
        self.poses, self.eta = by_robot[:, :POSE_SIZE], by_robot[:, POSE_SIZE:]

    def of_robot(self, robot: int) -> Indices:
        """Indices of a robot's pose and sensor errors."""
        return np.arange(self.own * robot, self.own * (robot + 1))

    @cached_property
    def deviations(self) -> Array:
        """Prior standard deviations of each robot's sensor errors, 0 where a sensor is exact, shape (N, q)."""
        return np.broadcast_to(self.errors.deviations, self.eta.shape)

    @cached_property
    def common(self) -> Indices:
        """Indices of the unknowns that belong to no single robot."""
        return np.arange(self.gyros.start, self.size)


@dataclass(frozen=True, eq=False)
class State:
    """A value of all unknowns.

    Attributes:
        poses: Poses of all grasp frames in the body frame.
        eta: Sensor errors, as sums of all steps, shape (N, q).
        calibration: ``T`` of each robot, shape (N, width, width); None if no errors are declared.
        gyros: Offset of the fused angular velocity, shape (3,) [rad/s].
        load: ``(wrench offset, theta)``, shape (16,); None while it is unknown.
    """

    poses: tuple[Pose, ...]
    eta: Array
    calibration: Array | None
    gyros: Array
    load: Array | None

    @property
    def fitted_load(self) -> Array:
        """The load, of a state that has one."""
        if self.load is None:
            raise ValueError("the state has no load; fit one first")
        return self.load

    @staticmethod
    def first(poses: Sequence[Pose], errors: SensorErrors) -> State:
        """A state with exact sensors and without a load."""
        eta = np.zeros((len(poses), errors.count))
        return State(tuple(poses), eta, errors.step(eta) if errors.count else None, np.zeros(3), None)

    def moved(self, step: Array, unknowns: Unknowns, farthest: float) -> State:
        """Return the state after a step (u,); sensor errors are clipped to ``farthest`` prior deviations."""
        turns, shifts = np.split(step[unknowns.poses], 2, axis=1)
        poses = tuple(
            Pose(turn @ pose.rotation, shift + pose.translation)
            for turn, shift, pose in zip(rotation_exp(turns), shifts, self.poses, strict=True)
        )
        eta, calibration = self.eta, self.calibration
        if calibration is not None:
            limit = farthest * unknowns.deviations
            eta = np.clip(eta + step[unknowns.eta], -limit, limit)
            calibration = unknowns.errors.step(eta - self.eta) @ calibration
        load = None if self.load is None else self.load + step[unknowns.load]
        return State(poses, eta, calibration, self.gyros + step[unknowns.gyros], load)

    def since(self, other: State, unknowns: Unknowns) -> Array:
        """Return the step (u,) from another state to this one, to first order."""
        step = np.zeros(unknowns.size)
        step[unknowns.poses] = [
            perturbation_between(then, now) for then, now in zip(other.poses, self.poses, strict=True)
        ]
        step[unknowns.eta], step[unknowns.gyros] = self.eta - other.eta, self.gyros - other.gyros
        if self.load is not None and other.load is not None:
            step[unknowns.load] = self.load - other.load
        return step

    def with_load(self, load: Array | None) -> State:
        """Return the same poses and sensors with another load, or with none."""
        return replace(self, load=load)
