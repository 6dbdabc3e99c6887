"""Delays of the robots' clocks, from the body's angular velocity according to each robot.

A robot whose clock is late by ``tau`` measures ``w(t - tau)``, about ``w - tau alpha``. Its grasp is then estimated
with a rotation by some ``phi``, which adds ``phi x w``. Both are fitted, with ``w`` and ``alpha`` from the others.
"""

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
    """Delay of each robot's poses against the mean of the others.

    Args:
        signals: Signals of N robots.
        poses: Poses of their grasp frames in the body frame.

    Returns:
        Delays and their standard deviations, shape (N,) each [s].
    """
    motions = body_motions(signals, poses)
    mean = others(motions)
    delays, deviations = np.empty(len(poses)), np.empty(len(poses))
    for robot, (own, other) in enumerate(zip(motions, mean, strict=True)):
        at = CubicSpline(signals.time, np.hstack([other[:, BODY_W], other[:, BODY_ALPHA]]))
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
        # Filtered samples are independent at every half period of the cutoff.
        variance = 0.5 * OVERSAMPLING * float(np.mean(left**2)) * np.linalg.pinv(columns.T @ columns)[0, 0]
        delays[robot], deviations[robot] = delay, np.sqrt(variance)
    return delays, deviations
