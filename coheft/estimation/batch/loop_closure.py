"""Poses of a whole team from the poses of its pairs, which do not agree around a loop.

Each pair's estimate stands for the data it came from: the data's cost is, near the estimate, the square of the
distance from it in the metric of its covariance. So the sum over all pairs is minimised over one pose per robot, which
closes all loops (a pose graph: Lu and Milios 1997; Zhang et al., sec. III-B).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from coheft.estimation.batch.team_poses import TeamPoses
from coheft.estimation.geometry.body_motion import perturbation_between, perturbed, relative_pose_derivative
from coheft.estimation.geometry.observability import Visibility
from coheft.estimation.geometry.spatial import Array, Pose, skew
from coheft.estimation.geometry.uncertain_pose import UncertainPose

_STEPS = 20
_CLOSE = 1e-9


@dataclass(frozen=True, eq=False)
class ClosedLoops:
    """One pose per robot.

    Attributes:
        team: All poses.
        is_settled: Whether steps had become small when no more were taken.
    """

    team: TeamPoses
    is_settled: bool


def close_loops(count: int, pairs: Mapping[tuple[int, int], UncertainPose]) -> ClosedLoops:
    """Poses of all robots in the first one's frame.

    Args:
        count: Number of robots.
        pairs: ``pose_j_in_i`` by ``(i, j)``; those with the first robot are all there.
    """
    poses = [Pose.identity(), *(pairs[0, j].pose for j in range(1, count))]
    weights = {pair: np.linalg.inv(estimate.covariance) for pair, estimate in pairs.items()}
    for _ in range(_STEPS):
        information, score = np.zeros((6 * count, 6 * count)), np.zeros(6 * count)
        for (i, j), estimate in pairs.items():
            derivative = _rows(poses, i, j)
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
    team = TeamPoses(tuple(poses), covariance * (len(pairs) / (count - 1)), Visibility())
    return ClosedLoops(team, is_settled)


def _rows(poses: list[Pose], i: int, j: int) -> Array:
    """How ``pose_j_in_i`` follows all robots' perturbations, shape (6, 6 N)."""
    own = relative_pose_derivative(poses[i], poses[j])
    rows = np.zeros((6, 6 * len(poses)))
    rows[:, 6 * i : 6 * i + 6], rows[:, 6 * j : 6 * j + 6] = own[:, :6], own[:, 6:]
    return rows


@dataclass(frozen=True, eq=False)
class LoopError:
    """By how much a loop of three robots fails to close.

    Attributes:
        error: Of the third one's pose by way of the second, ``(rotation, translation)``, shape (6,) [rad, m].
        deviations: Root mean square of it, in units of the standard deviations of the three pairs together.
    """

    error: Array
    deviations: float


def loop_errors(pairs: Mapping[tuple[int, int], UncertainPose]) -> list[LoopError]:
    """By how much each loop of three robots fails to close."""
    robots = sorted({robot for pair in pairs for robot in pair})
    errors = []
    for a, i in enumerate(robots):
        for b, j in enumerate(robots[a + 1 :], a + 1):
            for k in robots[b + 1 :]:
                if {(i, j), (j, k), (i, k)} <= set(pairs):
                    errors.append(_loop_error(pairs[i, j], pairs[j, k], pairs[i, k]))
    return errors


def _loop_error(first: UncertainPose, second: UncertainPose, both: UncertainPose) -> LoopError:
    """Of ``pose_j_in_i`` and ``pose_k_in_j`` together, compared with ``pose_k_in_i``."""
    turn = first.pose.rotation
    error = perturbation_between(both.pose, first.pose @ second.pose)
    by_first, by_second = np.eye(6), np.kron(np.eye(2), turn)
    by_first[3:, :3] = -skew(turn @ second.pose.translation)
    covariance = (
        by_first @ first.covariance @ by_first.T + by_second @ second.covariance @ by_second.T + both.covariance
    )
    return LoopError(error, float(np.sqrt(error @ np.linalg.solve(covariance, error) / len(error))))
