"""What may be wrong with robots that measure with encoders, and how it enters their samples.

A wrist is an arm that measures position and force in the axes of the robot's home frame, and a gimbal whose three
angles tell the orientation there, ``R = R_x(a) R_y(b) R_z(c)``. It measures

    (1 + angle_scale) angles + zero,    (1 + position_scale) position,    (1 + force_scale) force + force_offset.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from coheft.estimation.geometry.spatial import Array

ZERO, ANGLE_SCALE, POSITION_SCALE = slice(0, 3), slice(3, 6), slice(6, 7)
POSE_ERRORS = 7
"""Numbers per robot that poses depend on: zero [rad], angle scale, position scale."""
UNIFORM_BOUND = np.sqrt(3.0)
"""Of a uniform error, over its standard deviation."""
_EXACT = 1e-9
"""What is said to be without error may still have one of this size, so that all errors have a distribution."""


@dataclass(frozen=True)
class Tolerances:
    """How well robots are calibrated: standard deviations of what is wrong, before anything is measured.

    Scales and offsets are uniform: none is beyond ``UNIFORM_BOUND`` times its standard deviation.

    Attributes:
        zero: Of each gimbal angle's zero [rad].
        angle_scale: Relative, of each gimbal angle.
        position_scale: Relative.
        force_scale: Relative.
        force_offset: Of each axis [N].
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
        """Of errors that are uniform within plus or minus bounds; the misalignment is about a random axis."""
        return Tolerances(
            zero=float(np.radians(misalignment_deg) / 3.0),
            angle_scale=angle_scale / UNIFORM_BOUND,
            position_scale=position_scale / UNIFORM_BOUND,
            force_scale=force_scale / UNIFORM_BOUND,
            force_offset=force_offset / UNIFORM_BOUND,
        )

    def pose_errors(self) -> Array:
        """Of one robot's ``POSE_ERRORS``, shape (7,)."""
        return np.repeat([self.zero, self.angle_scale, self.position_scale], [3, 3, 1])

    def motion_errors(self, count: int) -> Array:
        """Of what the motion tells of N robots: the position scale of all, each force scale and offset, (1 + 4 N,)."""
        common = self.position_scale / np.sqrt(count)
        spread = np.repeat([common, self.force_scale, self.force_offset], [1, count, 3 * count])
        result: Array = np.maximum(spread, _EXACT)
        return result


def gimbal_angles(rotations: Array) -> Array:
    """``(a, b, c)`` [rad] of ``R_x(a) R_y(b) R_z(c)``, shape (..., 3, 3) to (..., 3)."""
    angles: Array = Rotation.from_matrix(rotations.reshape(-1, 3, 3)).as_euler("XYZ")
    return angles.reshape(rotations.shape[:-1])


def gimbal_rotations(angles: Array) -> Array:
    """Inverse of ``gimbal_angles``."""
    rotations: Array = Rotation.from_euler("XYZ", angles.reshape(-1, 3)).as_matrix()
    return rotations.reshape(*angles.shape, 3)


def gimbal_axes(angles: Array) -> Array:
    """Axes about which the three angles turn, in the home frame, as columns: shape (n, 3) to (n, 3, 3)."""
    a, b = angles[:, 0], angles[:, 1]
    axes = np.zeros((len(angles), 3, 3))
    axes[:, 0, 0] = 1.0
    axes[:, 1, 1], axes[:, 2, 1] = np.cos(a), np.sin(a)
    axes[:, 0, 2], axes[:, 1, 2], axes[:, 2, 2] = np.sin(b), -np.sin(a) * np.cos(b), np.cos(a) * np.cos(b)
    return axes


def corrected_poses(angles: Array, positions: Array, errors: Array) -> tuple[Array, Array]:
    """Rotations (n, 3, 3) and positions (n, 3) of one robot, from what it measured and its ``POSE_ERRORS`` (7,)."""
    rotations = gimbal_rotations((angles - errors[ZERO]) / (1.0 + errors[ANGLE_SCALE]))
    return rotations, positions / (1.0 + errors[POSITION_SCALE])
