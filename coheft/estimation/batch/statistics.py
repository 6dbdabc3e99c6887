"""Covariances of estimates whose residuals are correlated and of unknown size."""

import numpy as np
from scipy.ndimage import uniform_filter1d

from coheft.estimation.geometry.spatial import Array

SPAN = 1.0
"""Half of the time over which scores are summed [s]: longer than the correlation of filtered noise."""
_FEWEST_SUMS = 4
"""Least number of sums per unknown; in short recordings, sums are shorter."""
EXACT = 1e-5
"""Least deviation of a pose [rad, m]: no robot is calibrated better."""
_SINGULAR = 1e-12


def sandwich_information(derivative: Array, scores: Array, rate: float, least: Array) -> Array:
    """Information (u, u) on the solution of ``sum of scores = 0``, the inverse of its covariance (Huber 1967).

    Directions that are not observable have no information. Scores (n, u) at the solution are consecutive in time;
    ``derivative`` (u, u) is that of their sum by the unknowns, ``least`` (u, u) the sum's covariance due to rounding.
    """
    scatter = scatter_of_sum(scores, rate, len(derivative)) + least + EXACT**2 * derivative @ derivative.T
    balance = 1.0 / np.sqrt(np.maximum(np.diag(scatter), np.finfo(np.float64).tiny))
    balanced = scatter * balance[:, None] * balance + _SINGULAR * np.eye(len(scatter))
    half = balance[:, None] * derivative
    return half.T @ np.linalg.solve(balanced, half)


def span_length(count: int, rate: float, unknowns: int = 1) -> int:
    """Number of consecutive samples, of ``count``, to sum, so that sums are nearly independent and not too few."""
    return max(1, min(round(SPAN * rate), count // (_FEWEST_SUMS * unknowns)))


def scatter_of_sum(scores: Array, rate: float, reported: int) -> Array:
    """Covariance of the sum of consecutive scores (n, u) that are correlated, shape (u, u).

    It follows from weighted sums over twice ``SPAN``, whose weights rise and fall linearly (the lag window of Parzen
    1961). Sums with sharp ends would miss some of the correlation of filtered noise, and take differentiated noise,
    which cancels over time, for more than it is.

    The result is itself uncertain, as if it came from the squares of so many independent sums. So it is increased until
    the solution's squared error in units of its covariance is 1 per degree of freedom (Hotelling 1931); ``reported`` is
    the number of components of the solution that are reported together.
    """
    count, unknowns = scores.shape
    length = span_length(count, rate, unknowns)
    padded = np.pad(scores, ((2 * length, 2 * length), (0, 0)))
    sums = uniform_filter1d(uniform_filter1d(padded, length, axis=0), length, axis=0)
    squared_weights = (2.0 * length**2 + 1.0) / (3.0 * length**3)
    independent = _independent_sums(np.add.reduceat(scores, np.arange(0, count, length), axis=0))
    # The solution absorbs one of them.
    degrees = max(independent - reported - 2.0, 1.0)
    return sums.T @ sums * (max(independent / degrees, 1.0) / squared_weights)


def _independent_sums(sums: Array) -> float:
    """Number of sums of equal size that would determine a covariance as well as these (k, u) of unequal sizes do.

    From the fourth moment: with ``q = s^T S^-1 s`` and ``S`` the sum of all ``s s^T``, ``k`` normally distributed ones
    of equal size have the expectation ``u (u + 2) / (k + 2)`` of the sum of ``q^2``.
    """
    sizes = np.sqrt(np.square(sums).sum(axis=0))
    balanced = sums[:, sizes > 0.0] / sizes[sizes > 0.0]
    if not balanced.size:
        return float(len(sums))
    left, values, _ = np.linalg.svd(balanced, full_matrices=False)
    shown = left[:, values > _SINGULAR * values[0]]
    rank = shown.shape[1]
    fourth_moment = float(np.sum(np.square(shown).sum(axis=1) ** 2))
    return float(rank * (rank + 2.0) / fourth_moment) - 2.0
