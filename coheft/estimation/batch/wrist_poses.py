"""Encoder measurements of the robots' wrists: three angles of a gimbal and a position per sample."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from coheft.errors import RecordingError
from coheft.estimation.batch.calibration import gimbal_angles, gimbal_rotations
from coheft.estimation.geometry.spatial import Array

_LARGEST_TILT = 70.0
"""Largest second angle of the gimbal [degrees]; at 90 degrees it is singular."""


@dataclass(frozen=True, eq=False)
class WristPoses:
    """Measurements of N robots' encoders.

    Attributes:
        angles: Angles of the gimbals, shape (N, n, 3) [rad].
        positions: Positions in the home frames, shape (N, n, 3) [m].
        zeros: Orientations in the home frames at which the angles are zero, shape (N, 3, 3), or (N, n, 3, 3) if they
            differ by sample.
        rate: Samples per second.
    """

    angles: Array
    positions: Array
    zeros: Array
    rate: float

    @staticmethod
    def of(poses: Array, rate: float, *, at_home: bool) -> WristPoses:
        """Convert poses ``x y z qx qy qz qw`` in the home frames, shape (N, n, 7).

        Args:
            poses: The recorded poses.
            rate: Samples per second.
            at_home: Whether the angles are those of real gimbals, which are zero at home. Otherwise they are relative
                to the mean orientation, so that they are not singular.

        Raises:
            RecordingError: Real gimbals would be near their singularity.
        """
        rotations = Rotation.from_quat(poses[..., 3:].reshape(-1, 4)).as_matrix().reshape(*poses.shape[:2], 3, 3)
        zeros = np.tile(np.eye(3), (len(poses), 1, 1))
        if not at_home:
            zeros = np.array([Rotation.from_matrix(own).mean().as_matrix() for own in rotations])
        angles = gimbal_angles(zeros[:, None].swapaxes(-1, -2) @ rotations)
        largest = float(np.degrees(np.abs(angles[..., 1]).max()))
        if largest > _LARGEST_TILT:
            raise RecordingError(
                f"gimbals turn by {largest:.0f}° about their second axis, but only up to {_LARGEST_TILT:g}° can be "
                f"told from poses: give poses relative to a home in the middle of the motion"
            )
        return WristPoses(angles, poses[..., :3], zeros, rate)

    @staticmethod
    def without_gimbals(poses: Array) -> WristPoses:
        """Convert poses (N, n, 7) with large rotations between them: angles are relative to each pose."""
        zeros = Rotation.from_quat(poses[..., 3:].reshape(-1, 4)).as_matrix().reshape(*poses.shape[:2], 3, 3)
        return WristPoses(np.zeros((*poses.shape[:2], 3)), poses[..., :3], zeros, rate=1.0)

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
