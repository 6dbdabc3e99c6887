"""The twist relation in dual quaternions, linear in the unknown pose (Fan et al., eqs 10-15 and 38-40).

``q_r + eps q_d`` stands for ``pose_j_in_i``: ``q_r`` is its rotation, ``q_d = 1/2 p q_r`` holds its translation. Then
``H(w_i, w_j) q_r = 0`` and ``H(v_i, v_j) q_r + H(w_i, w_j) q_d = 0`` for every pair of twists of one rigid body.
Quaternions have their scalar first.
"""

import numpy as np
import numpy.typing as npt

from coheft.estimation.geometry.spatial import Array, Pose, quaternion_from_rotation, rotation_from_quaternion, skew


def left_multiplication(quaternion: npt.ArrayLike) -> Array:
    """``L(a)`` with ``L(a) b == a b``, shape (..., 4) to (..., 4, 4)."""
    return _multiplication(np.asarray(quaternion, dtype=np.float64), 1.0)


def right_multiplication(quaternion: npt.ArrayLike) -> Array:
    """``R(b)`` with ``R(b) a == a b``, shape (..., 4) to (..., 4, 4)."""
    return _multiplication(np.asarray(quaternion, dtype=np.float64), -1.0)


def _multiplication(q: Array, sign: float) -> Array:
    matrix = np.empty((*q.shape, 4))
    matrix[..., 0, :] = matrix[..., :, 0] = q
    matrix[..., 0, 1:] *= -1.0
    matrix[..., 1:, 1:] = q[..., :1, None] * np.eye(3) + sign * skew(q[..., 1:])
    return matrix


def pure(vector: npt.ArrayLike) -> Array:
    """Vectors (..., 3) as quaternions (..., 4) without scalar part."""
    vector = np.asarray(vector, dtype=np.float64)
    return np.concatenate([np.zeros((*vector.shape[:-1], 1)), vector], axis=-1)


def pair_operator(a: npt.ArrayLike, b: npt.ArrayLike) -> Array:
    """``H(a, b) = L(a) - R(b)`` of vectors (..., 3), shape (..., 4, 4): zero on ``q`` if and only if ``a q = q b``."""
    return left_multiplication(pure(a)) - right_multiplication(pure(b))


def dual_from_pose(pose: Pose) -> tuple[Array, Array]:
    """``q_r`` and ``q_d`` of a pose."""
    q_r = quaternion_from_rotation(pose.rotation)
    return q_r, 0.5 * left_multiplication(pure(pose.translation)) @ q_r


def pose_from_dual(q_r: Array, q_d: Array) -> Pose:
    """Pose of a unit dual quaternion: ``p = 2 q_d q_r*``."""
    conjugate = q_r * np.array([1.0, -1.0, -1.0, -1.0])
    return Pose(rotation_from_quaternion(q_r), 2.0 * (left_multiplication(q_d) @ conjugate)[1:])


def solve_rotation(moment_ww: Array) -> Array:
    """``q_r``: unit eigenvector of the smallest eigenvalue of ``sum H(w)^T W H(w)`` (4, 4) (eq. 38)."""
    q_r: Array = np.linalg.eigh(moment_ww)[1][:, 0]
    return -q_r if q_r[0] < 0.0 else q_r


def solve_translation(q_r: Array, moment_ww: Array, moment_wv: Array) -> Array:
    """``q_d``: least squares subject to ``q_r . q_d = 0``, by one Lagrange multiplier (eqs 39, 40).

    Args:
        q_r: The rotation, unit, shape (4,).
        moment_ww: ``sum H(w)^T W H(w)``, shape (4, 4), without the noise's share.
        moment_wv: ``sum H(w)^T W H(v)``, shape (4, 4).
    """
    system = np.zeros((5, 5))
    system[:4, :4] = moment_ww
    system[:4, 4] = system[4, :4] = q_r
    right_side = np.append(-moment_wv @ q_r, 0.0)
    # Least squares: before the first rotation the system is singular, and zero translation is the best guess.
    solution: Array = np.linalg.lstsq(system, right_side, rcond=1e-12)[0]
    return solution[:4]


def dual_tangent(q_r: Array, q_d: Array) -> Array:
    """Derivative of ``(q_r, q_d)`` with respect to ``(theta, dp)`` of ``UncertainPose``, shape (8, 6)."""
    half_turn = 0.5 * right_multiplication(q_r)[:, 1:]  # d(exp(theta / 2) q_r): theta acts on the left
    conjugate = q_r * np.array([1.0, -1.0, -1.0, -1.0])
    half_translation = left_multiplication(left_multiplication(q_d) @ conjugate)  # q_d = (p / 2) q_r
    derivative = np.zeros((8, 6))
    derivative[:4, :3] = half_turn
    derivative[4:, :3] = half_translation @ half_turn
    derivative[4:, 3:] = half_turn
    return derivative
