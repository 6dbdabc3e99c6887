"""The motion of the body, and the readings of a robot's sensors at its grasp.

A body motion is ``(w, v, a, alpha)`` of one frame fixed to the body, called the body frame here (in practice the grasp
frame of a reference robot), in its own axes: angular velocity [rad/s], velocity of the origin [m/s], proper
acceleration of the origin [m/s²], angular acceleration [rad/s²]; shape (n, 12).

Perturbations of a pose are ``(rotation, translation)``, shape (6,), in the axes of the frame in which the pose is
given: ``R <- exp(rotation) R`` and ``p <- p + translation``. Covariances of poses refer to them.
"""

import numpy as np

from coheft.estimation.geometry.spatial import Array, Pose, rotation_exp, rotation_log, skew

BODY_W = slice(0, 3)
BODY_V = slice(3, 6)
BODY_A = slice(6, 9)
BODY_ALPHA = slice(9, 12)
MOTION_SIZE = 12


def perturbed(pose: Pose, perturbation: Array) -> Pose:
    """Return the pose moved by ``(rotation, translation)``, shape (6,) [rad, m]."""
    return Pose(rotation_exp(perturbation[:3]) @ pose.rotation, pose.translation + perturbation[3:])


def perturbation_between(pose: Pose, other: Pose) -> Array:
    """Return the ``(rotation, translation)``, shape (6,) [rad, m], with ``perturbed(pose, result) == other``."""
    rotation = rotation_log(other.rotation @ pose.rotation.T)
    return np.concatenate([rotation, other.translation - pose.translation])


def relative_pose_derivative(pose_i: Pose, pose_j: Pose) -> Array:
    """Return the derivative of ``pose_j_in_i`` by perturbations of ``F_i`` and ``F_j``, both given in the body frame.

    Returns:
        Shape (6, 12): by the perturbation of ``pose_i``, then of ``pose_j``; the result is in the axes of ``F_i``.
    """
    to_i = pose_i.rotation.T
    derivative = np.zeros((6, 12))
    derivative[:3, 0:3] = derivative[3:, 3:6] = -to_i
    derivative[:3, 6:9] = derivative[3:, 9:12] = to_i
    derivative[3:, 0:3] = to_i @ skew(pose_j.translation - pose_i.translation)
    return derivative


def grasp_measurements(pose_i: Pose, motion: Array) -> Array:
    """Return the readings of noise-free sensors at ``F_i``.

    Args:
        pose_i: Pose of ``F_i`` in the body frame.
        motion: Body motion, shape (n, 12).

    Returns:
        ``w_i = R^T w``, ``v_i = R^T (v + w x p)``, ``a_i = R^T (a + alpha x p + w x (w x p))``, shape (n, 9).
    """
    rotation, p = pose_i.rotation, pose_i.translation
    w, v, a, alpha = (motion[:, part] for part in (BODY_W, BODY_V, BODY_A, BODY_ALPHA))
    at_grasp = (w, v + np.cross(w, p), a + np.cross(alpha, p) + np.cross(w, np.cross(w, p)))
    return np.concatenate([vector @ rotation for vector in at_grasp], axis=1)


def grasp_derivatives(pose_i: Pose, motion: Array) -> tuple[Array, Array]:
    """Return the derivatives of ``grasp_measurements``.

    Args:
        pose_i: Pose of ``F_i`` in the body frame.
        motion: Body motion, shape (n, 12).

    Returns:
        By the perturbation of the pose, shape (n, 9, 6), and by the body motion, shape (n, 9, 12).
    """
    p, to_i = pose_i.translation, pose_i.rotation.T
    w, alpha = motion[:, BODY_W], motion[:, BODY_ALPHA]
    spin = skew(w)
    in_body_axes = grasp_measurements(Pose(np.eye(3), p), motion).reshape(-1, 3, 3)
    by_pose = np.zeros((len(motion), 9, 6))
    by_pose[:, :, :3] = (to_i @ skew(in_body_axes)).reshape(-1, 9, 3)
    by_pose[:, 3:6, 3:] = to_i @ spin
    by_pose[:, 6:9, 3:] = to_i @ (skew(alpha) + spin @ spin)
    by_motion = np.zeros((len(motion), 9, MOTION_SIZE))
    by_motion[:, 0:3, BODY_W] = by_motion[:, 3:6, BODY_V] = by_motion[:, 6:9, BODY_A] = to_i
    by_motion[:, 3:6, BODY_W] = by_motion[:, 6:9, BODY_ALPHA] = -to_i @ skew(p)
    by_motion[:, 6:9, BODY_W] = to_i @ centripetal_derivative(w, p)
    return by_pose, by_motion


def centripetal_derivative(w: Array, p: Array) -> Array:
    """Return the derivative of ``w x (w x p)`` by ``w`` (n, 3), for one ``p`` (3,): shape (n, 3, 3)."""
    along = (w @ p)[:, None, None] * np.eye(3)
    return along + w[:, :, None] * p - 2.0 * p[:, None] * w[:, None, :]
