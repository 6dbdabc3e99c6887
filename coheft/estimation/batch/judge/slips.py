"""A grasp that slips: from some time on it is elsewhere in the load, and the robot's view of the load has a step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coheft.estimation.batch.judge.views import BATCH, Views
from coheft.estimation.geometry.spatial import Array, Pose

_FROM_THE_EDGE = 1.0
_LEFT = 0.1
"""Share of the squares that a slip may leave if it is the whole story."""


@dataclass(frozen=True)
class Slip:
    """One grasp's.

    Attributes:
        robot: Whose.
        time: When [s].
        turn_deg: By what angle.
        shift: How far the origin of the grasp frame went [m].
    """

    robot: int
    time: float
    turn_deg: float
    shift: float


def find_slip(views: Views, grasps: Sequence[Pose]) -> Slip | None:
    """The slip that explains nearly all by which robots' views of the load differ.

    Args:
        views: Of N robots.
        grasps: Grasp frames in the load, as fitted to all of it.

    Returns:
        None if there is none, or if it does not explain enough.
    """
    time, count = views.time, len(views.rest)
    inner = np.flatnonzero((time > time[0] + _FROM_THE_EDGE) & (time < time[-1] - _FROM_THE_EDGE))
    if not len(inner):
        return None
    # Steps from each batch on, of which constant errors of homes and grasps explain a part.
    explained = _from_each_on(views.scale[:, None] * views.basis)[inner]
    size = (len(time) - inner)[:, None, None] * np.diag(views.scale**2)
    inverse = np.linalg.pinv(size - explained @ explained.swapaxes(-1, -2), hermitian=True)
    score = _from_each_on((views.scale * views.rest).swapaxes(0, 1))[inner]
    solution = score @ inverse
    # A step of one robot moves the mean of all, from which views count, too.
    gains = np.sum(solution * score, axis=-1) * count / (count - 1)
    start, robot = map(int, np.unravel_index(int(np.argmax(gains)), gains.shape))
    before = float(np.sum(views.rest**2))
    if before - gains[start, robot] > _LEFT * before:
        return None
    jump = solution[start, robot] * count / (count - 1)
    # Perturbations are those of the load as the robot sees it, about the load's origin.
    shift = jump[3:] + np.cross(jump[:3], grasps[robot].translation)
    turn = float(np.degrees(np.linalg.norm(jump[:3])))
    return Slip(robot, float(time[inner[start]]) - 0.5 * BATCH, turn, float(np.linalg.norm(shift)))


def _from_each_on(samples: Array) -> Array:
    """Sums of samples (b, ...) from each to the last."""
    result: Array = np.cumsum(samples[::-1], axis=0)[::-1]
    return result
