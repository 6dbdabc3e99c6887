"""Effect of grasp poses on a result: its derivative, and the effect of rotations that are not observable."""

from collections.abc import Callable, Sequence

import numpy as np

from coheft.estimation.batch.team_poses import TeamPoses
from coheft.estimation.geometry.body_motion import perturbed
from coheft.estimation.geometry.spatial import Array, Pose

_ROTATION_STEP, _TRANSLATION_STEP = 1e-4, 1e-4
_TURNS = (2.0 * np.pi / 3.0, -2.0 * np.pi / 3.0)
"""Rotations that represent an arbitrary one about an axis that is not observable [rad]."""
_TURNING = 0.1
"""Directions with a smaller rotational part are translations."""


def turned_covariance(solve: Callable[[Sequence[Pose]], Array], team: TeamPoses) -> Array:
    """Covariance (u, u) of a result (u,) due to rotations of grasps that are not observable.

    These rotations are large, so that a derivative would not do: it is zero at a maximum, such as that of the sum of
    two forces that seem to be parallel.
    """
    result = solve(team.poses)
    covariance = np.zeros((len(result), len(result)))
    for robot in range(1, len(team.poses)):
        for direction in team.relative(0, robot).unobservable:
            size = float(np.linalg.norm(direction.rotation))
            if size < _TURNING:
                continue
            for turn in _TURNS:
                moved = list(team.poses)
                moved[robot] = perturbed(moved[robot], np.concatenate([turn / size * direction.rotation, np.zeros(3)]))
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
