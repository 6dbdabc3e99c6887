"""Corrects a fit with a Gaussian prior of the calibration errors for their bounds.

A Gaussian prior of the same width as the bounds makes the fit linear. The bounds matter where forces and lengths can
explain the same motion: the scales of all robots, whose ratios are known well, must be within them.
"""

from dataclasses import replace

import numpy as np
from scipy.optimize import lsq_linear
from scipy.special import ndtr, ndtri

from coheft.estimation.batch.calibrated_fit import CalibratedFit
from coheft.estimation.batch.calibration import UNIFORM_BOUND, Tolerances
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.rigid_body.regressor import INERTIA_SIZE

_SAMPLES = 2**14
_LEAST = 1e-2
"""Information that is added to all errors, as a share of the prior's, so that their likelihood is a distribution."""
_FARTHEST = 5.0
"""Standard deviations by which a recording may be off from the nearest errors within the bounds."""


def cut_to_bounds(fit: CalibratedFit, tolerances: Tolerances, position_scales: Array) -> CalibratedFit | None:
    """Mean and covariance with uniform errors within their bounds; None if the errors cannot be within.

    The inertia follows by its correlation with the errors.

    ``fit`` has a Gaussian prior; ``position_scales`` (N,) are those of the robots without the common scale.
    """
    count = len(position_scales)
    mean, errors = fit.numbers[INERTIA_SIZE:], fit.covariance[INERTIA_SIZE:, INERTIA_SIZE:]
    spread = tolerances.motion_errors(count)
    expected = np.zeros(len(mean))
    expected[0] = 1.0
    # What the recording alone says, in units of the prior's standard deviations.
    whitening = np.linalg.inv(np.linalg.cholesky(fit.noise / np.outer(spread, spread)))
    design, found = whitening @ (fit.shown / spread[:, None] * spread), whitening @ ((mean - expected) / spread)
    information = design.T @ design + _LEAST * np.eye(len(mean))
    covariance = np.linalg.inv(information).astype(np.float64)
    told = covariance @ design.T @ found
    widest = UNIFORM_BOUND * np.sqrt(count) * spread[0]
    lower, upper = np.full((2, len(mean)), UNIFORM_BOUND) * [[-1.0], [1.0]]
    lower[0] = ((1.0 + position_scales.max()) / (1.0 + widest) - 1.0) / spread[0]
    upper[0] = ((1.0 + position_scales.min()) / (1.0 - widest) - 1.0) / spread[0]
    if lower[0] >= upper[0]:
        return None
    root = np.linalg.cholesky(information).T
    if 2.0 * lsq_linear(root, root @ told, (lower, upper)).cost > _FARTHEST**2:
        return None
    samples, weight = _within(told, covariance, lower, upper)
    samples = expected + samples * spread
    cut = np.average(samples, axis=0, weights=weight)
    gain = np.linalg.solve(errors, fit.covariance[INERTIA_SIZE:]).T
    change = np.cov(samples, rowvar=False, aweights=weight) - errors
    return replace(fit, numbers=fit.numbers + gain @ (cut - mean), covariance=fit.covariance + gain @ change @ gain.T)


def _within(mean: Array, covariance: Array, lower: Array, upper: Array) -> tuple[Array, Array]:
    """Samples (s, u) of a normal distribution within bounds (u,), and their weights (s,).

    Each number is drawn within its bounds given those before; its probability to be there is a factor of the weight
    (Geweke 1991; Genz 1992). A normal distribution would hardly ever have all of many numbers within.
    """
    root = np.linalg.cholesky(covariance)
    uniform = np.random.default_rng(0).random((_SAMPLES, len(mean)))
    normal, log_weight = np.zeros_like(uniform), np.zeros(_SAMPLES)
    for k, own in enumerate(root):
        given = mean[k] + normal[:, :k] @ own[:k]
        low, high = (lower[k] - given) / own[k], (upper[k] - given) / own[k]
        # Probabilities are exact in the lower tail only.
        sign = np.where(low > 0.0, -1.0, 1.0)
        low, high = np.minimum(sign * low, sign * high), np.maximum(sign * low, sign * high)
        first, last = ndtr(low), ndtr(high)
        share = np.maximum(last - first, np.finfo(float).tiny)
        normal[:, k] = sign * np.clip(ndtri(first + uniform[:, k] * share), low, high)
        log_weight += np.log(share)
    return mean + normal @ root.T, np.exp(log_weight - log_weight.max())
