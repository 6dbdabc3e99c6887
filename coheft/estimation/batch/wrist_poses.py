"""Encoder measurements of the robots' wrists: three angles of a gimbal and a position per sample."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from coheft.estimation.batch.calibration import continuous_angles, gimbal_angles, gimbal_rotations
from coheft.estimation.geometry.spatial import Array

LARGEST_TILT = 70.0
"""Largest second angle of a gimbal [degrees]; at 90 degrees it is singular."""
_LONGEST_ARC = 0.02
"""Root mean square angle by which a load may turn while samples are averaged [rad]."""
_MOST_MEANS = 50_000
"""Largest number of means: a fit of four robots to so many takes 200 MB."""


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
