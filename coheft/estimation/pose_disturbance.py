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
    count = len(poses)
    alone = np.eye(6 * count) - _as_one_body(poses)
    blocks = (alone @ covariance @ alone.T).reshape(count, 6, count, 6)[range(count), :, range(count)]
    # Of robot j's unit force along its axis a, by perturbation k: entry [j, k, :, a].
    by_pose = np.array([adjoint_derivative(pose) for pose in poses])[..., :3]
    result: Array = np.einsum(
        "jkra,jkl,jlsa,j->rs", by_pose, blocks, by_pose, np.asarray(mean_square_forces) / 3.0, optimize=True
    )
    return result


def _as_one_body(poses: Sequence[Pose]) -> Array:
    """Projects perturbations of all poses on what they have in common: one small motion of the body frame.

    Returns:
        Shape (6 N, 6 N).
    """
    moved = np.tile(np.eye(6), (len(poses), 1, 1))
    moved[:, 3:, :3] = -skew(np.array([pose.translation for pose in poses]))
    stacked = moved.reshape(-1, 6)
    result: Array = stacked @ np.linalg.pinv(stacked)
    return result
