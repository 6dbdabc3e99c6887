"""A grasp that slips has another pose in the load from some time on: the robot's view of the load has a step."""

import numpy as np

from coheft.estimation.batch.judge.evidence import Evidence
from coheft.estimation.batch.judge.verdict import Cause, Verdict
from coheft.estimation.batch.judge.views import BATCH, Views
from coheft.estimation.geometry.spatial import Array

_FROM_THE_EDGE = 1.0
"""Slips in the first and the last second are not looked for [s]."""
_LEFT = 0.1
"""Share of the squared differences that a slip may leave unexplained."""


def find_slip(evidence: Evidence, views: Views) -> Verdict | None:
    """Find the slip that explains nearly all differences between the robots' views of the load; None if none does."""
    time, count = views.time, len(views.rest)
    inner = np.flatnonzero((time > time[0] + _FROM_THE_EDGE) & (time < time[-1] - _FROM_THE_EDGE))
    if not len(inner):
        return None
    # A step at each batch; constant errors of homes and grasps explain a part of it.
    explained = _sums_to_the_end(views.scale[:, None] * views.basis)[inner]
    size = (len(time) - inner)[:, None, None] * np.diag(views.scale**2)
    inverse = np.linalg.pinv(size - explained @ explained.swapaxes(-1, -2), hermitian=True)
    score = _sums_to_the_end((views.scale * views.rest).swapaxes(0, 1))[inner]
    solution = score @ inverse
    # A step of one robot also moves the mean of all, from which views are measured.
    gains = np.sum(solution * score, axis=-1) * count / (count - 1)
    start, robot = map(int, np.unravel_index(int(np.argmax(gains)), gains.shape))
    before = float(np.sum(views.rest**2))
    if before - gains[start, robot] > _LEFT * before:
        return None
    jump = solution[start, robot] * count / (count - 1)
    # It is a perturbation of the load as the robot sees it, about the load's origin.
    shift = float(np.linalg.norm(jump[3:] + np.cross(jump[:3], evidence.poses[robot].translation)))
    turn_deg, when = float(np.degrees(np.linalg.norm(jump[:3]))), float(time[inner[start]]) - 0.5 * BATCH
    culprit = evidence.culprit(robot)
    whose = culprit or f"{evidence.recording.names[robot]} (or of the other robot)"
    return Verdict(
        Cause.SLIP,
        culprit,
        (turn_deg, shift, when),
        f"the grasp of {whose} slipped at {when:.1f} s, by {1e3 * shift:.3g} mm and {turn_deg:.2g} degrees, or its "
        f"home moved: choose a part without this with --from and --to",
    )


def _sums_to_the_end(samples: Array) -> Array:
    """Sums of samples (b, ...) from each to the last."""
    return np.cumsum(samples[::-1], axis=0)[::-1]
