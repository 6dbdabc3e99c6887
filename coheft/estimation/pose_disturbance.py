"""How much poses that are off disturb a team's total wrench."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coheft.estimation.spatial import Array, Pose, skew
from coheft.estimation.twist_registration import adjoint_derivative


def wrench_disturbance(poses: Sequence[Pose], covariance: Array, mean_square_forces: Array) -> Array:
    """Covariance of what errors of poses add to the total wrench ``sum_j Ad(g_j) u_j`` of a sample, in the body frame.

    The robots' forces count as random, from any direction. If all poses are off alike, as those of one body, nothing is
    spoilt: everything is seen from another frame, the motion too.

    Args:
        poses: Of all robots in the body frame.
        covariance: Of their perturbations, shape (6 N, 6 N).
        mean_square_forces: Of every robot, shape (N,) [N²].

    Returns:
        Shape (6, 6) [N², N²·m, N²·m²].
    """
    count, forces = len(poses), np.asarray(mean_square_forces) / 3.0
    moved = _as_one_body(poses)
    stacked = moved.reshape(-1, 6)
    # Perturbations of all poses have in common what they say of one small motion of the body frame, by least squares.
    common = np.linalg.solve(stacked.T @ stacked, stacked.T)
    by_robot = covariance.reshape(len(poses), 6, len(poses), 6)[range(len(poses)), :, range(len(poses))]
    coupled = moved @ (common @ covariance).reshape(6, -1, 6).swapaxes(0, 1)
    alone = (
        by_robot - coupled - coupled.swapaxes(1, 2) + moved @ (common @ covariance @ common.T) @ moved.swapaxes(1, 2)
    )
    # Of robot j's unit force along its axis a, by perturbation k: entry [j, k, (a, :)].
    by_pose = np.array([adjoint_derivative(pose) for pose in poses])[..., :3].swapaxes(2, 3).reshape(count, 6, -1)
    spread = forces[:, None, None] * (alone @ by_pose)
    result: Array = by_pose.reshape(-1, 6).T @ spread.reshape(-1, 6)
    return result


def _as_one_body(poses: Sequence[Pose]) -> Array:
    """Perturbations of all poses when the body frame is perturbed, shape (N, 6, 6)."""
    moved = np.tile(np.eye(6), (len(poses), 1, 1))
    moved[:, 3:, :3] = -skew(np.array([pose.translation for pose in poses]))
    return moved
