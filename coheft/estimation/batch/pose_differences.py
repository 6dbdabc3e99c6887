"""How a result changes with the poses that it was found with: a little, and by turns that were not seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from coheft.estimation.batch.team_poses import TeamPoses
from coheft.estimation.geometry.body_motion import perturbed
from coheft.estimation.geometry.spatial import Array, Pose

_ROTATION_STEP, _TRANSLATION_STEP = 1e-4, 1e-4
_TURNS = (2.0 * np.pi / 3.0, -2.0 * np.pi / 3.0)
"""What a grasp may be turned by about an axis about which it was not seen [rad]: anything, and these show it."""
_TURNING = 0.1
"""Directions with less of a turn in them are translations."""


def turned_covariance(solve: Callable[[Sequence[Pose]], Array], team: TeamPoses) -> Array:
    """What a result (u,) gains in covariance (u, u) by turns of grasps that were not seen: they are not small.

    A derivative would not do: at a maximum it is zero, as that of the sum of two forces which were taken for parallel.
    """
    result = solve(team.poses)
    covariance = np.zeros((len(result), len(result)))
    for robot in range(1, len(team.poses)):
        for direction in team.relative(0, robot).unseen:
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

    Those of the first pose, which defines the frame, are left zero.
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
