"""Encoder measurements of the robots' wrists: three angles of a gimbal and a position per sample."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from coheft.estimation.batch.calibration import continuous_angles, gimbal_rotations
from coheft.estimation.geometry.spatial import Array

LARGEST_TILT = 70.0
"""Largest second angle of a gimbal [degrees]; at 90 degrees it is singular."""


@dataclass(frozen=True, eq=False)
class WristPoses:
    """Measurements of N robots' encoders.

    Attributes:
        angles: Angles of the gimbals, shape (N, n, 3) [rad].
        positions: Positions in the home frames, shape (N, n, 3) [m].
        zeros: Orientations in the home frames at which the angles are zero, shape (N, 3, 3), or (N, n, 3, 3) if they
            differ by sample.
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

        Args:
            poses: The recorded poses.
            rate: Samples per second.
            at_home: Whether to take robots for ones with gimbals, which are zero at home, except those whose second
                angle would exceed ``LARGEST_TILT``. Angles of all others are relative to the mean orientation, so that
                they are not singular.
        """
        rotations = Rotation.from_quat(poses[..., 3:].reshape(-1, 4)).as_matrix().reshape(*poses.shape[:2], 3, 3)
        has_gimbal = np.full(len(poses), at_home)
        has_gimbal &= np.abs(rotations[..., 0, 2]).max(axis=1) <= np.sin(np.radians(LARGEST_TILT))
        zeros = np.array(
            [
                np.eye(3) if gimbal else Rotation.from_matrix(own).mean().as_matrix()
                for own, gimbal in zip(rotations, has_gimbal, strict=True)
            ]
        )
        angles = continuous_angles(zeros[:, None].swapaxes(-1, -2) @ rotations)
        return WristPoses(angles, poses[..., :3], zeros, rate, has_gimbal)

    @staticmethod
    def without_gimbals(poses: Array) -> WristPoses:
        """Convert poses (N, n, 7) with large rotations between them: angles are relative to each pose."""
        zeros = Rotation.from_quat(poses[..., 3:].reshape(-1, 4)).as_matrix().reshape(*poses.shape[:2], 3, 3)
        return WristPoses(np.zeros((*poses.shape[:2], 3)), poses[..., :3], zeros, 1.0, np.zeros(len(poses), np.bool_))

    def some(self, rows: slice) -> WristPoses:
        """Only some samples."""
        zeros = self.zeros[:, rows] if self.zeros.ndim == 4 else self.zeros
        return replace(self, angles=self.angles[:, rows], positions=self.positions[:, rows], zeros=zeros)

    def averaged(self, rate: float) -> WristPoses:
        """Means of neighbouring samples, about ``rate`` of them per second."""
        length = max(1, int(self.rate / rate))
        count = self.angles.shape[1] // length

        def mean(samples: Array) -> Array:
            result: Array = samples[:, : count * length].reshape(len(samples), count, length, 3).mean(axis=2)
            return result

        return replace(self, angles=mean(self.angles), positions=mean(self.positions), rate=self.rate / length)

    def rotations(self, robot: int) -> Array:
        """Measured orientations of a grasp frame in its home frame, shape (n, 3, 3)."""
        result: Array = self.zeros[robot] @ gimbal_rotations(self.angles[robot])
        return result
