"""Whether all robots' poses are of the same instants, by what each says of the body's angular velocity.

A clock that is late by ``tau`` makes a robot say ``w(t - tau)``, about ``w - tau alpha``, and turns the grasp that is
found for it by some ``phi``, which adds ``phi x w``. The others know ``w`` and ``alpha``, with noise of their own.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from coheft.estimation.batch.body import body_motions
from coheft.estimation.batch.inertia_fit import others
from coheft.estimation.batch.signals import OVERSAMPLING, Signals
from coheft.estimation.geometry.body_motion import BODY_ALPHA, BODY_W
from coheft.estimation.geometry.spatial import Array, Pose

_STEPS, _STEP, _LONGEST, _FOUND = 12, 0.1, 1.0, 1e-4
"""Of Gauss-Newton [s]."""


def clock_delays(signals: Signals, poses: Sequence[Pose]) -> tuple[Array, Array]:
    """How late each robot's poses are against the mean of all others.

    Args:
        signals: Of N robots.
        poses: Of their grasp frames in the body frame.

    Returns:
        Delays and their standard deviations, shape (N,) each [s].
    """
    motions = body_motions(signals, poses)
    mean = others(motions)
    delays, deviations = np.empty(len(poses)), np.empty(len(poses))
    for robot, (own, said) in enumerate(zip(motions, mean, strict=True)):
        at = CubicSpline(signals.time, np.hstack([said[:, BODY_W], said[:, BODY_ALPHA]]))
        delay = 0.0
        for _ in range(_STEPS):
            w, alpha = np.hsplit(at(np.clip(signals.time - delay, signals.time[0], signals.time[-1])), 2)
            turned = [np.cross(axis, w).ravel() for axis in np.eye(3)]
            columns = np.stack([-alpha.ravel(), *turned], axis=-1)
            difference = (own[:, BODY_W] - w).ravel()
            solution = np.linalg.lstsq(columns, difference)[0]
            delay = float(np.clip(delay + np.clip(solution[0], -_STEP, _STEP), -_LONGEST, _LONGEST))
            if abs(solution[0]) < _FOUND:
                break
        left = difference - columns @ solution
        # What went through the filter is independent every half of its period.
        variance = 0.5 * OVERSAMPLING * float(np.mean(left**2)) * np.linalg.pinv(columns.T @ columns)[0, 0]
        delays[robot], deviations[robot] = delay, np.sqrt(variance)
    return delays, deviations
