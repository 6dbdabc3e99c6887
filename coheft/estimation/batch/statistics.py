"""Covariances of estimates whose residuals are correlated and of unknown size."""

from __future__ import annotations

import numpy as np

from coheft.estimation.geometry.spatial import Array

SPAN = 1.0
"""Time over which scores are summed [s]: much longer than the correlation of filtered noise."""
_FEWEST_SUMS = 4
"""Least number of sums per unknown; in short recordings, sums are shorter."""
EXACT = 1e-5
"""Least deviation of a pose [rad, m]: no robot is calibrated better."""
_SINGULAR = 1e-12


def sandwich_information(derivative: Array, scores: Array, rate: float, least: Array) -> Array:
    """Information (u, u) on the solution of ``sum of scores = 0``, the inverse of its covariance (Huber 1967).

    The scatter of the scores follows from their sums over ``SPAN``, which are nearly independent (batch means).
    Directions that are not observable have no information.

    Args:
        derivative: Derivative of the summed scores by the unknowns, shape (u, u).
        scores: Scores at the solution, consecutive in time, shape (n, u).
        rate: Samples per second.
        least: Covariance of the summed scores due to rounding, shape (u, u).
    """
    scatter = batch_scatter(scores, rate) + least + EXACT**2 * derivative @ derivative.T
    balance = 1.0 / np.sqrt(np.maximum(np.diag(scatter), np.finfo(np.float64).tiny))
    balanced = scatter * balance[:, None] * balance + _SINGULAR * np.eye(len(scatter))
    half = balance[:, None] * derivative
    information: Array = half.T @ np.linalg.solve(balanced, half)
    return information


def span_length(count: int, rate: float, unknowns: int = 1) -> int:
    """Number of consecutive samples, of ``count``, to sum, so that sums are nearly independent and not too few."""
    return max(1, min(round(SPAN * rate), count // (_FEWEST_SUMS * unknowns)))


def batch_scatter(scores: Array, rate: float) -> Array:
    """Covariance of the sum of consecutive scores (n, u), shape (u, u)."""
    count, unknowns = scores.shape
    sums = np.add.reduceat(scores, np.arange(0, count, span_length(count, rate, unknowns)), axis=0)
    # The solution absorbs some of the scatter.
    degrees = max(len(sums) - unknowns / 2.0, 1.0)
    scatter: Array = sums.T @ sums * (len(sums) / degrees)
    return scatter
