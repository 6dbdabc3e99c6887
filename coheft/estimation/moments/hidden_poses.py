"""Residuals of total wrenches at the poses that explain them best, where the motion does not show the poses.

    rho(x) = sum_i Ad(g_i) u_i - X(psi) theta - offset,    x = x_fit + root z,    min |rho|^2 + |z|^2

``root root^T`` is the covariance of a fit, which is wide in hidden directions. A fit makes no step in these: internal
forces that vary leave larger residuals than noise. At the best ``x`` they are as small if sensors are right.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments import rows
from coheft.estimation.moments.body import FORCING, REGRESSOR, load_operator, residual_covariance
from coheft.estimation.moments.fit import FARTHEST, Estimate
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.rows import ROW_SIZE, WRENCH_SIZE

_MOST_STEPS = 6
"""Right sensors need two to six steps; wrong ones can only be explained by more, far away."""
_DAMPING, _LESS, _MORE = 1e-3, 0.2, 4.0
"""First damping of Levenberg-Marquardt steps, relative to the information, and its factors after good and bad ones."""
_SMALL = 0.1
"""Steps that reduce the sum of squares by less are not made."""
_SINGULAR = 1e-12
"""Share of the largest variance below which a direction is known."""


class BestResiduals(NamedTuple):
    """Residuals at the best poses and load.

    Attributes:
        residuals: Of total wrenches in standard deviations, shape (n, 1, 6).
        moved: The step ``z`` to them, shape (k,); squares of both add up to as many as there are residuals, on average.
    """

    residuals: Array
    moved: Array


def best_residuals(estimate: Estimate, settings: FitSettings, extended_rows: Array) -> BestResiduals:
    """Find the best poses and load by Levenberg-Marquardt steps, and return what they leave of rows with that load (n,
    X).

    The estimate is a fit with hidden poses and a load; its motion and sensor errors are kept.
    """
    body, unknowns, first = estimate.body, estimate.body.unknowns, estimate.state.fitted_load
    white = np.linalg.inv(np.linalg.cholesky(residual_covariance(body, first)))
    number, motion = len(extended_rows), extended_rows @ body.motion_map[FORCING].T
    wrenches = extended_rows[:, : body.one].reshape(number, body.count, ROW_SIZE)[:, :, rows.WRENCH].reshape(number, -1)
    at_fit = (extended_rows @ body.wrench_map.T - motion @ load_operator(first).T) @ white.T

    root = _root(estimate)
    by_load = np.einsum("ab,fbl,lk->fak", white, REGRESSOR, root[unknowns.load])
    of_load = (motion @ by_load.reshape(len(by_load), -1)).reshape(6 * number, -1)
    now, residuals, moved, damping = body, at_fit, np.zeros(root.shape[1]), _DAMPING
    square, one = float(np.square(at_fit).sum()), np.eye(len(moved))
    for _ in range(_MOST_STEPS):
        # Sensor errors change these derivatives so little that steps lead to the same place.
        by_pose = np.einsum("ab,rpbw,rpk->rwak", white, now.adjoint_derivatives(), root[unknowns.poses])
        jacobian = (wrenches @ by_pose.reshape(body.count * WRENCH_SIZE, -1)).reshape(6 * number, -1) - of_load
        information, score = jacobian.T @ jacobian + one, -(jacobian.T @ residuals.ravel() + moved)
        while True:
            step = np.linalg.solve(information + damping * np.diag(information.diagonal()), score)
            if not (2.0 * score - information @ step) @ step >= _SMALL:
                return BestResiduals(residuals[:, None], moved)
            there = settings.body(now.state.moved(root @ step, unknowns, FARTHEST))
            by_rows = white @ (there.wrench_map - body.wrench_map)
            by_motion = white @ load_operator(there.state.fitted_load - first)
            found = at_fit + extended_rows @ by_rows.T - motion @ by_motion.T
            sum_of_squares = float(np.square(found).sum() + np.square(moved + step).sum())
            if sum_of_squares < square:
                break
            damping *= _MORE
        now, moved, residuals, square, damping = there, moved + step, found, sum_of_squares, damping * _LESS
    return BestResiduals(residuals[:, None], moved)


def _root(estimate: Estimate) -> Array:
    """Return a root (u, k) of the covariance of poses and load."""
    unknowns = estimate.body.unknowns
    free = np.concatenate([unknowns.poses.ravel(), np.arange(unknowns.size)[unknowns.load]])
    variances, directions = np.linalg.eigh(estimate.covariance[np.ix_(free, free)])
    kept = variances > _SINGULAR * variances[-1]
    root = np.zeros((unknowns.size, int(kept.sum())))
    root[free] = directions[:, kept] * np.sqrt(variances[kept])
    return root
