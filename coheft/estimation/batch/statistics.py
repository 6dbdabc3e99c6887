"""How certain an estimate is whose residuals are neither white nor of known size."""

from __future__ import annotations

import numpy as np

from coheft.estimation.geometry.spatial import Array

SPAN = 1.0
"""Scores are summed over so long [s]: much longer than filtered noise is correlated."""
_FEWEST_SUMS = 4
"""Per unknown; of short recordings the sums are over less."""
EXACT = 1e-5
"""No pose is known better than this [rad, m], whatever exact numbers say: 10 µm, beyond any robot's calibration."""
_SINGULAR = 1e-12


def sandwich_information(derivative: Array, scores: Array, rate: float, least: Array) -> Array:
    """Information on the solution of ``sum of scores = 0``: inverse of its covariance (Huber 1967).

    The scatter of the scores is taken from their sums over ``SPAN``, which hardly depend on each other (batch means).
    What the data do not show at all has no information, which is no error.

    Args:
        derivative: Of the summed scores by the unknowns, shape (u, u).
        scores: At the solution, shape (n, u), consecutive in time.
        rate: Samples per second.
        least: Covariance that the sum of scores has at least, whatever its scatter, shape (u, u): what was computed
            without noise is still rounded.

    Returns:
        Shape (u, u).
    """
    scatter = batch_scatter(scores, rate) + least + EXACT**2 * derivative @ derivative.T
    balance = 1.0 / np.sqrt(np.maximum(np.diag(scatter), np.finfo(np.float64).tiny))
    balanced = scatter * balance[:, None] * balance + _SINGULAR * np.eye(len(scatter))
    half = balance[:, None] * derivative
    information: Array = half.T @ np.linalg.solve(balanced, half)
    return information


def span_length(count: int, rate: float, unknowns: int = 1) -> int:
    """Over how many of ``count`` consecutive samples to sum, that sums hardly depend on each other and are enough."""
    return max(1, min(round(SPAN * rate), count // (_FEWEST_SUMS * unknowns)))


def batch_scatter(scores: Array, rate: float) -> Array:
    """Covariance of the sum of consecutive scores (n, u), shape (u, u)."""
    count, unknowns = scores.shape
    sums = np.add.reduceat(scores, np.arange(0, count, span_length(count, rate, unknowns)), axis=0)
    # The solution takes up some of the scatter.
    degrees = max(len(sums) - unknowns / 2.0, 1.0)
    scatter: Array = sums.T @ sums * (len(sums) / degrees)
    return scatter
