"""Corrects a fit with a Gaussian prior of the calibration errors for their bounds.

A Gaussian prior of the same width as the bounds makes the fit linear. The bounds matter where forces and lengths can
explain the same motion: the scales of all robots, whose ratios are known well, must be within them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from coheft.estimation.batch.calibrated_fit import CalibratedFit
from coheft.estimation.batch.calibration import UNIFORM_BOUND, Tolerances
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.rigid_body.regressor import INERTIA_SIZE

_SAMPLES = 2**16
_FEWEST = 100.0
"""Least effective number of samples within the bounds; with fewer, the bounds contradict the recording."""


def cut_to_bounds(fit: CalibratedFit, tolerances: Tolerances, position_scales: Array) -> CalibratedFit | None:
    """Mean and covariance with uniform errors within their bounds; None if the errors cannot be within.

    Samples of the errors from the fit are weighted by the ratio of the uniform to the Gaussian prior. The inertia
    follows by its correlation with the errors.

    Args:
        fit: The fit with a Gaussian prior.
        tolerances: The tolerances of the prior.
        position_scales: Each robot's position scale without the common scale, shape (N,).
    """
    count = len(position_scales)
    mean, errors = fit.numbers[INERTIA_SIZE:], fit.covariance[INERTIA_SIZE:, INERTIA_SIZE:]
    spread = tolerances.motion_errors(count)
    samples = np.random.default_rng(0).multivariate_normal(mean, errors, size=_SAMPLES)
    scales = (1.0 + position_scales) / samples[:, :1] - 1.0
    inside = (np.abs(scales) <= UNIFORM_BOUND * np.sqrt(count) * spread[0]).all(axis=1)
    inside &= (np.abs(samples[:, 1:]) <= UNIFORM_BOUND * spread[1:]).all(axis=1)
    expected = np.zeros(len(mean))
    expected[0] = 1.0
    if not inside.any():
        return None
    samples = samples[inside]
    exponent = 0.5 * np.square((samples - expected) / spread).sum(axis=1)
    weight = np.exp(exponent - exponent.max())
    if weight.sum() ** 2 < _FEWEST * np.square(weight).sum():
        return None
    cut = np.average(samples, axis=0, weights=weight)
    gain = np.linalg.solve(errors, fit.covariance[INERTIA_SIZE:]).T
    change = np.cov(samples, rowvar=False, aweights=weight) - errors
    return replace(fit, numbers=fit.numbers + gain @ (cut - mean), covariance=fit.covariance + gain @ change @ gain.T)
