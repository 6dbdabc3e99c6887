"""How certain an estimate is whose residuals are neither white nor of known size."""

from __future__ import annotations

import numpy as np

from coheft.estimation.spatial import Array

SPAN = 1.0
"""Scores are summed over so long [s]: much longer than filtered noise is correlated."""


def sandwich(derivative: Array, scores: Array, rate: float) -> Array:
    """Covariance of the solution of ``sum of scores = 0`` (Huber 1967), for correlated samples.

    The scatter of the scores is taken from their sums over ``SPAN``, which hardly depend on each other (batch means).

    Args:
        derivative: Of the summed scores by the unknowns, shape (u, u).
        scores: At the solution, shape (n, u), consecutive in time.
        rate: Samples per second.

    Returns:
        Shape (u, u).
    """
    inverse = np.linalg.inv(derivative)
    covariance: Array = inverse @ batch_scatter(scores, rate) @ inverse.T
    return covariance


def batch_scatter(scores: Array, rate: float) -> Array:
    """Covariance of the sum of consecutive scores (n, u), shape (u, u)."""
    sums = np.add.reduceat(scores, np.arange(0, len(scores), max(1, round(SPAN * rate))), axis=0)
    # The solution takes up some of the scatter.
    degrees = max(len(sums) - scores.shape[1] / 2.0, 1.0)
    scatter: Array = sums.T @ sums * (len(sums) / degrees)
    return scatter
