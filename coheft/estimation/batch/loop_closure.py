"""Poses of a whole team from the poses of its pairs, which do not agree around loops.

The sum of the squared errors of all pairs, weighted by their covariances, is minimised over one pose per robot, which
closes all loops (a pose graph: Lu and Milios 1997; Zhang et al., sec. III-B).
"""

from collections.abc import Mapping
from itertools import combinations

import msgspec
import numpy as np

from coheft.estimation.batch.team_poses import TeamPoses
from coheft.estimation.geometry.body_motion import perturbation_between, perturbed, relative_pose_derivative
from coheft.estimation.geometry.spatial import Pose, skew
from coheft.estimation.geometry.uncertain_pose import UncertainPose

_STEPS = 20
_CLOSE = 1e-9


def close_loops(count: int, pairs: Mapping[tuple[int, int], UncertainPose]) -> TeamPoses:
    """Poses of all robots in the first one's frame, from ``pose_j_in_i`` by ``(i, j)``, for all ``j`` if ``i = 0``."""
    poses = [Pose.identity(), *(pairs[0, j].pose for j in range(1, count))]
    weights = {pair: np.linalg.inv(estimate.covariance) for pair, estimate in pairs.items()}
    for _ in range(_STEPS):
        information, score = np.zeros((6 * count, 6 * count)), np.zeros(6 * count)
        for (i, j), estimate in pairs.items():
            own = relative_pose_derivative(poses[i], poses[j])
            derivative = np.zeros((6, 6 * count))
            derivative[:, 6 * i : 6 * i + 6], derivative[:, 6 * j : 6 * j + 6] = own[:, :6], own[:, 6:]
            error = perturbation_between(poses[i].inverse() @ poses[j], estimate.pose)
            information += derivative.T @ weights[i, j] @ derivative
            score += derivative.T @ weights[i, j] @ error
        covariance = np.zeros_like(information)
        covariance[6:, 6:] = np.linalg.inv(information[6:, 6:])
        step = (covariance @ score).reshape(count, 6)
        poses = [perturbed(pose, move) for pose, move in zip(poses, step, strict=True)]
        is_settled = bool(np.abs(step).max() < _CLOSE)
        if is_settled:
            break
    # The pairs share their robots' noise: N (N - 1) / 2 of them know no more than N - 1 independent ones.
    return TeamPoses(tuple(poses), covariance * (len(pairs) / (count - 1)), is_settled)


class LoopError(msgspec.Struct, frozen=True):
    """By how much a loop of three robots fails to close: the third one's pose by way of the second.

    Attributes:
        rotation_deg: Angle of the error [degrees].
        position_mm: Distance [mm].
        deviations: Root mean square of both, in standard deviations of the three pairs together.
    """

    rotation_deg: float
    position_mm: float
    deviations: float


def loop_errors(pairs: Mapping[tuple[int, int], UncertainPose]) -> list[LoopError]:
    """Errors of all loops of three robots whose pairs ``(i, j)``, ``i < j``, are all there."""
    errors = []
    for i, j, k in combinations(sorted({robot for pair in pairs for robot in pair}), 3):
        if not {(i, j), (j, k), (i, k)} <= set(pairs):
            continue
        first, second, both = pairs[i, j], pairs[j, k], pairs[i, k]
        turn = first.pose.rotation
        error = perturbation_between(both.pose, first.pose @ second.pose)
        by_first, by_second = np.eye(6), np.kron(np.eye(2), turn)
        by_first[3:, :3] = -skew(turn @ second.pose.translation)
        covariance = by_first @ first.covariance @ by_first.T + by_second @ second.covariance @ by_second.T
        covariance += both.covariance
        errors.append(
            LoopError(
                rotation_deg=float(np.degrees(np.linalg.norm(error[:3]))),
                position_mm=float(1e3 * np.linalg.norm(error[3:])),
                deviations=float(np.sqrt(error @ np.linalg.solve(covariance, error) / len(error))),
            )
        )
    return errors
