"""Rigid-body frames: rotations, poses, and the transformation of twists and wrenches between frames.

Conventions, used everywhere in coheft:

- ``F_i`` is the grasp frame of robot i, fixed to the payload. ``pose_j_in_i`` is the pose of ``F_j`` in ``F_i``; points
  transform by ``x_i = R_ij x_j + p_ij``.
- A twist is ``(w, v)``: angular velocity [rad/s], then velocity of the frame's origin [m/s].
- A wrench is ``(f, t)``: force [N], then torque about the frame's origin [N·m].

In these orders twists and wrenches transform with the same 6x6 matrix, ``Pose.adjoint``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_SMALL_ANGLE = 1e-2
"""Angle below which a series is more exact [rad]."""
_ROTATION_TOLERANCE = 1e-6
_AXES = np.eye(3)
_CROSS = np.zeros((3, 9))
"""Cross-product matrices of the three axes, row by row."""
_CROSS[[0, 1, 2], [7, 2, 3]], _CROSS[[0, 1, 2], [5, 6, 1]] = 1.0, -1.0


def skew(x: npt.ArrayLike) -> Array:
    """Return the cross-product matrix: ``skew(x) @ y == np.cross(x, y)``.

    Args:
        x: Vectors, shape (..., 3).

    Returns:
        Shape (..., 3, 3).
    """
    x = np.asarray(x, dtype=np.float64)
    return (x @ _CROSS).reshape(*x.shape, 3)


CROSS_OF_AXES: Array = skew(np.eye(3))
"""Cross-product matrices of the axes, shape (3, 3, 3)."""


def rotation_coefficients(rotation_vectors: Array) -> tuple[Array, Array, Array]:
    """Return ``sin x / x``, ``(1 - cos x) / x²`` and ``(x - sin x) / x³`` of the vectors' lengths, accurate for small
    ones.

    Args:
        rotation_vectors: Shape (..., 3) [rad].

    Returns:
        Each of shape (..., 1).
    """
    angle = np.linalg.norm(rotation_vectors, axis=-1, keepdims=True)
    once = np.sinc(angle / np.pi)
    twice = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    is_small = angle < _SMALL_ANGLE
    safe = np.where(is_small, 1.0, angle)
    thrice = np.where(is_small, 1.0 / 6.0 - angle**2 / 120.0 + angle**4 / 5040.0, (1.0 - once) / safe**2)
    return once, twice, thrice


def rotation_exp(rotation_vectors: npt.ArrayLike) -> Array:
    """Return rotation matrices (..., 3, 3) of rotation vectors (..., 3) [rad] (Rodrigues)."""
    vectors = np.asarray(rotation_vectors, dtype=np.float64)
    once, twice, _ = rotation_coefficients(vectors)
    cross = skew(vectors)
    return _AXES + once[..., None] * cross + twice[..., None] * cross @ cross


def rotation_log(rotation: Array) -> Array:
    """Return the rotation vector (3,) [rad], of norm at most pi, of a rotation matrix (3, 3)."""
    quaternion = quaternion_from_rotation(rotation)
    imaginary = quaternion[1:]
    sine_half = float(np.linalg.norm(imaginary))
    if sine_half < 1e-9:
        return 2.0 * imaginary
    angle = 2.0 * np.arctan2(sine_half, quaternion[0])
    result: Array = (angle / sine_half) * imaginary
    return result


def quaternion_from_rotation(rotation: Array) -> Array:
    """Return the unit quaternion (4,), scalar first and not negative, of a rotation matrix (3, 3).

    The largest component is computed first, so the result is accurate for every rotation (Shepperd 1978).
    """
    r = rotation
    trace = r[0, 0] + r[1, 1] + r[2, 2]
    squares = np.array([trace, r[0, 0], r[1, 1], r[2, 2]])
    largest = int(np.argmax(squares))
    q = np.empty(4)
    if largest == 0:
        q[:] = 1.0 + trace, r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
    else:
        i = largest - 1
        j, k = (i + 1) % 3, (i + 2) % 3
        q[0] = r[k, j] - r[j, k]
        q[1 + i] = 1.0 + r[i, i] - r[j, j] - r[k, k]
        q[1 + j] = r[j, i] + r[i, j]
        q[1 + k] = r[k, i] + r[i, k]
    q /= np.linalg.norm(q)
    return -q if q[0] < 0.0 else q


def rotation_from_quaternion(quaternion: npt.ArrayLike) -> Array:
    """Return rotation matrices (..., 3, 3) of unit quaternions (..., 4), scalar first."""
    w, x, y, z = np.moveaxis(np.asarray(quaternion, dtype=np.float64), -1, 0)
    matrix = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return np.moveaxis(matrix, (0, 1), (-2, -1))


@dataclass(frozen=True, eq=False)
class Pose:
    """Pose of one frame in another: a rigid transform of SE(3).

    ``pose_j_in_i`` transforms coordinates from ``F_j`` to ``F_i``, and ``pose_j_in_i @ pose_k_in_j == pose_k_in_i``.

    Attributes:
        rotation: ``R_ij``, shape (3, 3).
        translation: ``p_ij``, the origin of ``F_j`` in ``F_i``, shape (3,) [m].
    """

    SIZE: ClassVar[int] = 12
    """Length of ``numbers``."""

    rotation: Array
    translation: Array

    @staticmethod
    def identity() -> Pose:
        """Return the pose of a frame in itself."""
        return Pose(np.eye(3), np.zeros(3))

    def inverse(self) -> Pose:
        """Return ``pose_i_in_j`` of ``pose_j_in_i``."""
        return self._inverse

    @cached_property
    def _inverse(self) -> Pose:
        return Pose(self.rotation.T, -self.rotation.T @ self.translation)

    def __matmul__(self, other: Pose) -> Pose:
        return Pose(self.rotation @ other.rotation, self.rotation @ other.translation + self.translation)

    def apply(self, points: npt.ArrayLike) -> Array:
        """Transform points (..., 3) from ``F_j`` to ``F_i``: ``x_i = R_ij x_j + p_ij``."""
        return np.asarray(points) @ self.rotation.T + self.translation

    @staticmethod
    def of_numbers(numbers: npt.ArrayLike) -> Pose:
        """Make a pose from its ``numbers``.

        Raises:
            ValueError: Their number is not ``SIZE``.
        """
        array = np.array(numbers, dtype=np.float64)
        if array.shape != (Pose.SIZE,):
            raise ValueError(f"{array.shape=} but expected ({Pose.SIZE},)")
        return Pose(array[:9].reshape(3, 3), array[9:])

    def is_rigid(self) -> bool:
        """Whether the rotation matrix is valid and all numbers are finite; for poses from outside."""
        if not np.isfinite(self.translation).all():
            return False
        is_orthonormal = np.abs(self.rotation.T @ self.rotation - _AXES).max() < _ROTATION_TOLERANCE
        return bool(is_orthonormal and np.linalg.det(self.rotation) > 0.0)

    def numbers(self) -> Array:
        """Return the rotation row by row, then the translation: shape (12,)."""
        return np.concatenate([self.rotation.ravel(), self.translation])

    def adjoint(self) -> Array:
        """Return the matrix (6, 6) that transforms twists ``(w, v)``, and wrenches ``(f, t)``, from ``F_j`` to ``F_i``.

        ``w_i = R w_j, v_i = R v_j + p x R w_j`` and ``f_i = R f_j, t_i = R t_j + p x R f_j`` have the same matrix
        (Murray, Li, Sastry 1994, eqs 2.57 and 2.66, in the orders above). The array is read-only.
        """
        return self._adjoint

    @cached_property
    def _adjoint(self) -> Array:
        matrix = np.zeros((6, 6))
        matrix[:3, :3] = matrix[3:, 3:] = self.rotation
        matrix[3:, :3] = skew(self.translation) @ self.rotation
        matrix.flags.writeable = False
        return matrix
