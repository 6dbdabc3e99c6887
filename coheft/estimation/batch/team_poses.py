"""Grasp poses of a team with their joint covariance, and the effect of their uncertainty on a result."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from coheft.estimation.geometry.body_motion import perturbed, relative_pose_derivative
from coheft.estimation.geometry.observability import PoseEstimate, SeenInformation
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.rigid_body.unobservable import middle_and_size

_ROTATION_STEP, _TRANSLATION_STEP = 1e-4, 1e-4
_TURNS = (2.0 * np.pi / 3.0, -2.0 * np.pi / 3.0)
"""Rotations that represent an arbitrary one about an axis that is not observable [rad]."""
_AWAY = 10.0
"""Translation that represents an arbitrary one, in multiples of the size of the team."""
_TURNING = 0.1
"""Directions with a smaller rotational part are translations."""


@dataclass(frozen=True, eq=False)
class TeamPoses:
    """Poses of all robots' grasp frames.

    Attributes:
        poses: Poses in the reference robot's grasp frame, the first one.
        covariance: Covariance of all perturbations, shape (6 N, 6 N); zero for the first pose.
        is_settled: Whether the fit has converged.
    """

    poses: tuple[Pose, ...]
    covariance: Array
    is_settled: bool = True

    @property
    def is_observable(self) -> bool:
        """Whether all poses are observable."""
        return not any(self.relative(0, other).unobservable for other in range(1, len(self.poses)))

    @property
    def seen(self) -> tuple[Pose, ...]:
        """The first pose, and those that are observable."""
        return tuple(pose for k, pose in enumerate(self.poses) if not k or not self.relative(0, k).unobservable)

    def relative(self, i: int, j: int) -> PoseEstimate:
        """``pose_j_in_i`` of two different robots."""
        derivative = relative_pose_derivative(self.poses[i], self.poses[j])
        by_robot = self.covariance.reshape(len(self.poses), 6, len(self.poses), 6)
        covariance = derivative @ by_robot[[i, j]][:, :, [i, j]].reshape(12, 12) @ derivative.T
        seen = SeenInformation.of(np.linalg.inv(covariance).astype(np.float64))
        return PoseEstimate(self.poses[i].inverse() @ self.poses[j], covariance, seen.unobservable())


def unseen_covariance(solve: Callable[[Sequence[Pose]], Array], team: TeamPoses) -> Array:
    """Covariance (u, u) of a result (u,) due to directions of grasps that are not observable.

    Rotations are large, so that a derivative would not do: it is zero at a maximum, such as that of the sum of two
    forces that seem to be parallel. Translations are as large as noise makes them, which its covariance does not tell.
    """
    result = solve(team.poses)
    covariance = np.zeros((len(result), len(result)))
    away = _AWAY * middle_and_size(team.poses)[1]
    for robot in range(1, len(team.poses)):
        for direction in team.relative(0, robot).unobservable:
            size = float(np.linalg.norm(direction.rotation))
            if size < _TURNING:
                moves = [np.concatenate([np.zeros(3), away * direction.translation])]
            else:
                moves = [np.concatenate([turn / size * direction.rotation, np.zeros(3)]) for turn in _TURNS]
            for move in moves:
                moved = list(team.poses)
                moved[robot] = perturbed(moved[robot], move)
                change = solve(moved) - result
                covariance += np.outer(change, change)
    return covariance


def derivative_by_poses(solve: Callable[[Sequence[Pose]], Array], poses: Sequence[Pose]) -> Array:
    """Derivative (u, 6 N) of a result (u,) by the perturbations of all poses, by central differences.

    The columns of the first pose, which defines the frame, are zero.
    """
    columns = []
    steps = np.repeat([_ROTATION_STEP, _TRANSLATION_STEP], 3)
    for robot in range(1, len(poses)):
        for axis, step in zip(np.eye(6), steps, strict=True):
            moved = [
                solve([perturbed(pose, sign * step * axis) if k == robot else pose for k, pose in enumerate(poses)])
                for sign in (1.0, -1.0)
            ]
            columns.append((moved[0] - moved[1]) / (2.0 * step))
    result: Array = np.stack(columns, axis=1)
    return np.hstack([np.zeros((len(result), 6)), result])
