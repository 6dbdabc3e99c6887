"""Encoder measurements of the robots' wrists: three angles of a gimbal and a position per sample, and their errors.

A robot has an arm, which measures position and force in the axes of its home frame, and a gimbal with three angles,
which measures the orientation ``R = R_x(a) R_y(b) R_z(c)``. It measures

    (1 + angle_scale) angles + zero,    (1 + position_scale) position,    (1 + force_scale) force + force_offset.

A robot whose orientations no such gimbal can have has no errors of angles.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from coheft.estimation.geometry.spatial import Array

ZERO, ANGLE_SCALE, POSITION_SCALE = slice(0, 3), slice(3, 6), slice(6, 7)
ANGLE_ERRORS = slice(0, 6)
"""All errors of a gimbal."""
POSE_ERRORS = 7
"""Number of a robot's errors that affect poses: zeros [rad], angle scales, position scale."""
UNIFORM_BOUND = np.sqrt(3.0)
"""Bound of a uniform distribution, in its standard deviations."""
_EXACT = 1e-9
"""Least standard deviation of an error, so that all errors have a distribution."""
LARGEST_TILT = 70.0
"""Largest second angle of a gimbal [degrees]; at 90 degrees it is singular."""
_LONGEST_ARC = 0.02
"""Root mean square angle by which a load may turn while samples are averaged [rad]."""
_MOST_MEANS = 50_000
"""Largest number of means: a fit of four robots to so many takes 200 MB."""


@dataclass(frozen=True)
class Tolerances:
    """Prior standard deviations of the robots' calibration errors.

    Scales and offsets are uniformly distributed, within ``UNIFORM_BOUND`` times their standard deviations.

    Attributes:
        zero: Zero of each gimbal angle [rad].
        angle_scale: Relative scale of each gimbal angle.
        position_scale: Relative scale of positions.
        force_scale: Relative scale of forces.
        force_offset: Offset of each axis of the force [N].
    """

    zero: float
    angle_scale: float
    position_scale: float
    force_scale: float
    force_offset: float

    @staticmethod
    def of_bounds(
        misalignment_deg: float, angle_scale: float, position_scale: float, force_scale: float, force_offset: float
    ) -> Tolerances:
        """Tolerances of uniform errors within plus or minus these bounds; the misalignment is about a random axis."""
        return Tolerances(
            zero=float(np.radians(misalignment_deg) / 3.0),
            angle_scale=angle_scale / UNIFORM_BOUND,
            position_scale=position_scale / UNIFORM_BOUND,
            force_scale=force_scale / UNIFORM_BOUND,
            force_offset=force_offset / UNIFORM_BOUND,
        )

    def pose_errors(self) -> Array:
        """Standard deviations of one robot's ``POSE_ERRORS``, shape (7,)."""
        return np.repeat([self.zero, self.angle_scale, self.position_scale], [3, 3, 1])

    def motion_errors(self, count: int) -> Array:
        """Of the common position scale of N robots, and of each force scale and offset, shape (1 + 4 N,)."""
        common = self.position_scale / np.sqrt(count)
        spread = np.repeat([common, self.force_scale, self.force_offset], [1, count, 3 * count])
        result: Array = np.maximum(spread, _EXACT)
        return result


def gimbal_angles(rotations: Array) -> Array:
    """``(a, b, c)`` [rad] of ``R_x(a) R_y(b) R_z(c)``, shape (..., 3, 3) to (..., 3)."""
    angles: Array = Rotation.from_matrix(rotations.reshape(-1, 3, 3)).as_euler("XYZ")
    return angles.reshape(rotations.shape[:-1])


def continuous_angles(rotations: Array) -> Array:
    """``gimbal_angles`` over time, (..., n, 3, 3) to (..., n, 3) [rad], without jumps by a whole turn.

    An encoder's angle does not jump at half a turn, and its scale error multiplies the whole angle.
    """
    angles = np.unwrap(gimbal_angles(rotations), axis=-2)
    return angles - whole_turns(angles.mean(axis=-2, keepdims=True))


def whole_turns(angles: Array) -> Array:
    """The multiples of a whole turn nearest to angles [rad]."""
    return 2.0 * np.pi * np.rint(angles / (2.0 * np.pi))


def gimbal_rotations(angles: Array) -> Array:
    """Inverse of ``gimbal_angles``."""
    rotations: Array = Rotation.from_euler("XYZ", angles.reshape(-1, 3)).as_matrix()
    return rotations.reshape(*angles.shape, 3)


def gimbal_axes(angles: Array) -> Array:
    """Rotation axes of the three angles (n, 3) in the home frame, as columns, shape (n, 3, 3)."""
    a, b = angles[:, 0], angles[:, 1]
    axes = np.zeros((len(angles), 3, 3))
    axes[:, 0, 0] = 1.0
    axes[:, 1, 1], axes[:, 2, 1] = np.cos(a), np.sin(a)
    axes[:, 0, 2], axes[:, 1, 2], axes[:, 2, 2] = np.sin(b), -np.sin(a) * np.cos(b), np.cos(a) * np.cos(b)
    return axes


def corrected_poses(angles: Array, positions: Array, errors: Array) -> tuple[Array, Array]:
    """Rotations (n, 3, 3) and positions (n, 3) of one robot, from measurements (n, 3) and ``POSE_ERRORS`` (7,)."""
    rotations = gimbal_rotations((angles - errors[ZERO]) / (1.0 + errors[ANGLE_SCALE]))
    return rotations, positions / (1.0 + errors[POSITION_SCALE])


@dataclass(frozen=True, eq=False)
class WristPoses:
    """Measurements of N robots' encoders.

    Attributes:
        angles: Angles of the gimbals, shape (N, n, 3) [rad].
        positions: Positions in the home frames, shape (N, n, 3) [m].
        zeros: Orientations in the home frames at which the angles are zero, shape (N, n, 3, 3): home of a robot with a
            gimbal, otherwise the measured ones themselves, near which no angles are singular.
        rate: Samples per second.
        has_gimbal: Whether a robot's angles are those of a gimbal, which has calibration errors, shape (N,).
    """

    angles: Array
    positions: Array
    zeros: Array
    rate: float
    has_gimbal: npt.NDArray[np.bool_]

    @staticmethod
    def of(poses: Array, rate: float, *, at_home: bool) -> WristPoses:
        """Convert poses ``x y z qx qy qz qw`` in the home frames, shape (N, n, 7).

        With ``at_home``, robots are taken for ones with gimbals that are zero at home, except those whose second angle
        would exceed ``LARGEST_TILT``.
        """
        zeros = Rotation.from_quat(poses[..., 3:].reshape(-1, 4)).as_matrix().reshape(*poses.shape[:2], 3, 3)
        has_gimbal = np.full(len(poses), at_home)
        has_gimbal &= np.abs(zeros[..., 0, 2]).max(axis=1) <= np.sin(np.radians(LARGEST_TILT))
        angles = np.zeros((*poses.shape[:2], 3))
        for robot in np.flatnonzero(has_gimbal):
            angles[robot], zeros[robot] = continuous_angles(zeros[robot]), np.eye(3)
        return WristPoses(angles, poses[..., :3], zeros, rate, has_gimbal)

    def some(self, rows: slice) -> WristPoses:
        """Only some samples."""
        return replace(self, angles=self.angles[:, rows], positions=self.positions[:, rows], zeros=self.zeros[:, rows])

    def averaged(self, rate: float) -> WristPoses:
        """Means of neighbouring samples, about ``rate`` of them per second, or more if the load turns fast.

        The mean of positions on an arc lies inside of it, by the square of the angle / 24 as a share of the radius. Of
        very many means only some are kept.
        """
        length = max(1, int(self.rate / rate))
        ends = self.some(slice(None, None, length)).rotations(0)
        turns = Rotation.from_matrix(ends[:-1].swapaxes(-1, -2) @ ends[1:]).magnitude()
        arc = max(_LONGEST_ARC, float(np.sqrt(np.mean(turns**2))))
        length = max(1, int(length * _LONGEST_ARC / arc))
        count = self.angles.shape[1] // length

        def batches(samples: Array) -> Array:
            return samples[:, : count * length].reshape(len(samples), count, length, *samples.shape[2:])

        zeros = batches(self.zeros)
        middle = zeros[:, :, length // 2]
        angles = batches(self.angles) + gimbal_angles(middle[:, :, None].swapaxes(-1, -2) @ zeros)
        every = -(-count // _MOST_MEANS)
        means = replace(
            self,
            angles=angles.mean(axis=2),
            positions=batches(self.positions).mean(axis=2),
            zeros=middle,
            rate=self.rate / length / every,
        )
        return means.some(slice(None, None, every))

    def rotations(self, robot: int) -> Array:
        """Measured orientations of a grasp frame in its home frame, shape (n, 3, 3)."""
        result: Array = self.zeros[robot] @ gimbal_rotations(self.angles[robot])
        return result
