"""Delays of the robots' clocks, from the body's angular velocity according to each robot.

A robot whose clock is late by ``tau`` measures ``w(t - tau)``, about ``w - tau alpha``. Its grasp is then estimated
with a rotation by some ``phi``, which adds ``phi x w``. Both are fitted, with ``w`` and ``alpha`` from the others. Only
the part of ``alpha`` on which the robot and the others agree shows a delay: the rest is noise.
"""

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from coheft.estimation.batch.body import body_motions
from coheft.estimation.batch.inertia_fit import others
from coheft.estimation.batch.signals import Signals
from coheft.estimation.geometry.body_motion import BODY_ALPHA, BODY_W
from coheft.estimation.geometry.spatial import Array, Pose

_STEPS, _STEP, _LONGEST, _FOUND = 12, 0.1, 1.0, 1e-4
"""Of Gauss-Newton [s]."""


def clock_delays(signals: Signals, poses: Sequence[Pose]) -> tuple[Array, Array]:
    """Delay of each robot's motion against the mean of the others'; ``poses`` are in the body frame.

    Returns:
        Delays and their standard deviations, shape (N,) each [s]; infinite if there is nothing but noise.
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
        delays[robot], deviations[robot] = delay, _deviation(left, columns, own[:, BODY_ALPHA].ravel())
    return delays, deviations


def _deviation(left: Array, columns: Array, acceleration: Array) -> float:
    """Standard deviation of a delay [s].

    ``left`` (3 n,) are residuals of the angular velocity, of all axes in turn, ``columns`` (3 n, 4) derivatives by the
    delay, which are noisy, and by a rotation, and ``acceleration`` (3 n,) is the robot's own.
    """
    turns = columns[:, 1:]
    shown = columns[:, 0] - turns @ np.linalg.lstsq(turns, columns[:, 0])[0]
    agreed = -float(shown @ acceleration)
    if agreed <= 0.0:
        return np.inf
    # The deviation of their scalar product if residuals of the same spectrum had random phases.
    powers = [np.abs(np.fft.fft(signal.reshape(-1, 3), axis=0)) ** 2 for signal in (left, shown)]
    return float(np.sqrt(np.sum(powers[0] * powers[1])) / (len(left) / 3) / agreed)
