"""Score tests for delays whose tolerance is zero, by how much the readings change from row to row.

    s = sum_n d_n . r_n,    s^2 / sum_n |d_n|^2 ~ chi-square at most

``r_n`` are the residuals of a row, ``d_n`` their derivative by the delay of one robot's sensors. A reading changes per
second as between the rows before and after, so the noise of ``d_n`` is independent of that of ``r_n``; where residuals
are corrected by rates, from samples of these two rows, the rows beside them are taken. What the fit's unknowns explain
of a delay is not projected out: rarely much, and the test only becomes less sensitive.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from coheft.estimation.chi_square import chi_square_threshold
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.body import BodyModel
from coheft.estimation.moments.rows import KINEMATICS, ROW_SIZE, TWIST, WRENCH
from coheft.estimation.moments.sensor_errors import DELAYS
from coheft.estimation.moments.undeclared import UndeclaredError
from coheft.estimation.moments.unknowns import Indices


def late_sensor(
    body: BodyModel,
    rows: Array,
    numbers: Indices,
    residuals: Callable[[Array], tuple[Array, Array]],
    by_wrench: Array,
    period: float,
    false_alarm: float,
) -> UndeclaredError | None:
    """Return the most significant delay with tolerance zero, None if all are declared or there are too few rows.

    Args:
        body: Matrices at the fit.
        rows: Extended rows of the present load, shape (n, X).
        numbers: Their numbers, shape (n,).
        residuals: Gives those of rows, whitened: of the total wrench (n, 1, 6), and of motion sensors (n, N, 12).
        by_wrench: Takes extended rows to the whitened residual of the total wrench, shape (6, X).
        period: Duration of a row [s].
        false_alarm: False-alarm probability for one delay.
    """
    errors, deviations, far = body.unknowns.errors, body.unknowns.deviations, 2 if body.has_rates else 1
    is_tested = np.array([(deviations[:, errors.are(kind)] == 0.0).all(axis=1) for kind in DELAYS])  # shape (2, N)
    between = numbers[2 * far :] - numbers[: -2 * far] == 2 * far
    if not is_tested.any() or not between.any():
        return None
    count, size = body.count, body.one
    change = (rows[2 * far :, :size] - rows[: -2 * far, :size])[between]
    change = change.reshape(-1, count, ROW_SIZE) / (2.0 * far * period)
    wrench, motion = residuals(rows[far:-far][between])

    own = change[:, :, KINEMATICS]
    if body.state.calibration is not None:
        own = (body.state.calibration[:, KINEMATICS, :ROW_SIZE] @ change.transpose(1, 2, 0)).transpose(2, 0, 1)
    of_motion = np.sqrt(body.weight) * own
    of_motion[:, :, TWIST] -= of_motion[:, :, TWIST].mean(axis=0)  # as means of twists are removed
    by_robot = by_wrench[:, :size].reshape(6, count, ROW_SIZE).transpose(1, 2, 0)
    of_clock = (change.transpose(1, 0, 2) @ by_robot).transpose(1, 0, 2)
    of_delay = (change[:, :, WRENCH].transpose(1, 0, 2) @ by_robot[:, WRENCH]).transpose(1, 0, 2)

    by_motion = np.array([(of_motion * motion).sum(axis=(0, 2)), np.zeros(count)])
    score = by_motion + [(each * wrench).sum(axis=(0, 2)) for each in (of_clock, of_delay)]
    variance = np.array([np.square(of_motion).sum(axis=(0, 2)), np.zeros(count)])
    variance += [np.square(each).sum(axis=(0, 2)) for each in (of_clock, of_delay)]
    sizes = np.where(is_tested, score**2 / np.maximum(variance, 1e-300), 0.0) / chi_square_threshold(1, false_alarm)
    kind, robot = np.unravel_index(int(sizes.argmax()), sizes.shape)
    is_clear = count > 2 or DELAYS[kind] != "clock"  # two clocks differ, but which of them is off?
    return UndeclaredError(int(robot) if is_clear else None, DELAYS[kind], float(sizes[kind, robot]))
