"""Innovations of rows at one estimate: 13 numbers of the motion, the total wrench, and all residuals of each row.

(motion[FORCING], wrench, whitened residual of the wrench, motion) = matrix @ row,    r_i = y_i - predict_i @ motion
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.body import (
    FORCING,
    FORCING_SIZE,
    MOTION_SIZE,
    REGRESSOR,
    load_operator,
    residual_covariance,
)
from coheft.estimation.moments.change import InformationMaps, Look, StepThresholds, look_for_change, one_kilogram
from coheft.estimation.moments.chapter import Chapter
from coheft.estimation.moments.derivatives import MotionDerivatives, prediction_covariance
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.moments import view_moments
from coheft.estimation.moments.row_buffer import VIEW_SIZE
from coheft.estimation.moments.rows import KINEMATICS_SIZE, ROW_SIZE, TWIST, WRENCH_SIZE
from coheft.estimation.moments.undeclared import UndeclaredError, late_sensor
from coheft.estimation.moments.unknowns import LOAD_SIZE, THETA

_MOTION = VIEW_SIZE + WRENCH_SIZE
_WRENCH = slice(VIEW_SIZE, _MOTION)
"""Where residuals of the wrench are in an evaluated row, and where the motion begins."""
ROWS_BEFORE = 100
"""The mean row of earlier chapters weighs at most as much as so many rows."""


class Past(NamedTuple):
    """Rows of earlier chapters: their mean, an extended row (X,), and as how many ``rows`` it weighs."""

    rows: float
    mean: Array


class EvaluatedRow(NamedTuple):
    """An evaluated row.

    Attributes:
        view: ``(motion[FORCING], wrench)``, shape (19,).
        wrench: Residual of the total wrench in standard deviations, shape (6,).
        mass: The part of it along what another mass would make it, a standard normal number at the true load; 0
            without a load.
        motion: Residuals of all robots' motion sensors in standard deviations, shape (12 N,).
    """

    view: Array
    wrench: Array
    mass: float
    motion: Array


class Innovations:
    """Evaluates rows at an estimate, and tests those that are kept for a change. The views in the chapter's buffer are
    replaced by those at this estimate.

    ``mean_residuals`` are those of all gyros and velocity sensors, in standard deviations, shape (12 N,).
    """

    def __init__(self, estimate: Estimate, chapter: Chapter, past: Past | None = None) -> None:
        body, buffer, load = estimate.body, chapter.buffer, estimate.state.load
        if load is None:  # residuals of wrenches are not used then
            load = np.zeros(LOAD_SIZE)
        self._buffer, self._estimate = buffer, estimate
        of_all, of_load = buffer.moments()
        see = np.vstack([body.motion_map[FORCING], body.wrench_map])
        buffer.views[: buffer.count] = buffer.rows[: buffer.count] @ see.T
        self._older = np.zeros((VIEW_SIZE, VIEW_SIZE))  # Gram matrix of views of rows that are not kept
        if not buffer.keeps_whole_load:
            kept = buffer.views[buffer.of_load]
            self._older = view_moments(body, of_load) - kept.T @ kept
        self._knows_load = chapter.knows_load and buffer.keeps_whole_load
        self._maps = InformationMaps.of(body, load, chapter.prior_evidence(body))
        root = np.linalg.cholesky(residual_covariance(body, load))
        whitened = np.linalg.solve(root, body.wrench_map - load_operator(load) @ body.motion_map[FORCING])
        self._by_mass = one_kilogram(load) @ np.linalg.solve(root, REGRESSOR[:, :, THETA]).swapaxes(1, 2)  # (13, 6)
        self._body, self._matrix = body, np.vstack([see, whitened, body.motion_map[:MOTION_SIZE]])
        sums, self.mean_residuals = of_all.sums(body.one), np.zeros(KINEMATICS_SIZE * body.count)
        rows = float(sums[body.one])
        if past is not None:  # a mean over few rows would be as noisy as the rows that are tested
            sums, rows = sums + past.rows * past.mean, rows + past.rows
        self._until_now = Past(rows, sums / max(rows, 1.0))
        mean = self.evaluate(self._until_now.mean).motion  # without the mean residuals, which are zero up to here
        self.mean_residuals = np.where(np.arange(len(mean)) % KINEMATICS_SIZE < TWIST.stop, mean, 0.0)

    @property
    def past(self) -> Past:
        """All rows up to now, for the next chapter, whose estimates are better for their mean residuals."""
        return self._until_now._replace(rows=min(self._until_now.rows, ROWS_BEFORE))

    @property
    def past_before_slip(self) -> Past:
        """The same, with a made-up mean row that gives the present mean residuals at any poses.

        When a grasp slips, poses change, and predictions with them; mean residuals are errors of sensors, and stay.
        """
        mean = np.zeros_like(self._until_now.mean)
        mean[self._body.one] = 1.0
        by_robot = mean[: self._body.one].reshape(-1, ROW_SIZE)
        root, mean_residuals = np.sqrt(self._body.weight), self.mean_residuals.reshape(-1, KINEMATICS_SIZE)
        by_robot[:, :KINEMATICS_SIZE] = np.divide(
            mean_residuals, root, out=np.zeros_like(mean_residuals), where=root > 0.0
        )
        return self.past._replace(mean=mean)

    def evaluate(self, row: Array) -> EvaluatedRow:
        """Evaluate an extended row (X,)."""
        evaluated = self._matrix @ row
        motion = self._body.residuals(row[None], evaluated[None, _MOTION:])[0] - self.mean_residuals
        view, wrench = evaluated[:VIEW_SIZE], evaluated[_WRENCH]
        by_mass = view[:FORCING_SIZE] @ self._by_mass
        mass = float(by_mass @ wrench) / max(math.sqrt(by_mass @ by_mass), 1e-300)
        return EvaluatedRow(view, wrench, mass, motion)

    @cached_property
    def _derivatives(self) -> MotionDerivatives:
        return MotionDerivatives.at(self._body)

    def motion_uncertainty(self, newest: Array, robot: int, rows: int) -> Array:
        """Covariance of a robot's residuals, averaged over so many newest rows, by errors of the estimate and of mean
        residuals, shape (12, 12). The newest of these rows, shape (X,), is not in the buffer yet.
        """
        count, body, past = self._buffer.count, self._body, self._until_now
        mean = (self._buffer.rows[max(0, count - rows + 1) : count].sum(axis=0) + newest) / rows
        psi, change = body.motion_map @ mean, body.motion_map @ (mean - past.mean)
        result = prediction_covariance(body, self._derivatives, self._estimate.covariance, robot, psi, change)
        of_twists = np.arange(TWIST.start, TWIST.stop)
        result[of_twists, of_twists] += 1.0 / max(past.rows, 1.0)
        return result

    def residuals(self, rows: Array) -> tuple[Array, Array]:
        """Return residuals of extended rows (n, X): of the wrench (n, 1, 6), and of motion sensors (n, N, 12)."""
        evaluated = rows @ self._matrix[VIEW_SIZE:].T
        motion = self._body.residuals(rows, evaluated[:, WRENCH_SIZE:]) - self.mean_residuals
        return evaluated[:, None, :WRENCH_SIZE], motion.reshape(len(rows), -1, KINEMATICS_SIZE)

    def late_sensor(self, period: float, false_alarm: float) -> UndeclaredError | None:
        """Run the test for delays with tolerance zero on the rows of the load, see ``late_sensors.late_sensor``."""
        buffer, by_wrench = self._buffer, self._matrix[_WRENCH]
        rows, numbers = buffer.rows[buffer.of_load], buffer.numbers[buffer.of_load]
        return late_sensor(self._body, rows, numbers, self.residuals, by_wrench, period, false_alarm)

    def gram(self) -> Array:
        """Return the Gram matrix of the views of all rows of the load, shape (19, 19)."""
        views = self._buffer.views[self._buffer.of_load]
        return self._older + views.T @ views

    def mass_information(self) -> float:
        """Return the information of one row on the mass [1/kg²], mean over all rows of the load."""
        of_motion = self.gram()[:FORCING_SIZE, :FORCING_SIZE]
        return float(np.sum(self._by_mass * (of_motion @ self._by_mass)) / max(of_motion[0, 0], 1.0))

    def look_for_change(self, small: StepThresholds | None = None) -> Look:
        """Run the first test for a load change on all rows of the load.

        See ``coheft.estimation.moments.change.look_for_change``.
        """
        views = self._buffer.views[self._buffer.of_load]
        return look_for_change(views, self._older, self._maps, self._knows_load, small)
