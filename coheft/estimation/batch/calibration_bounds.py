"""Calibration errors have bounds: an estimate that took them for Gaussian, once what is beyond is ruled out.

A Gaussian prior makes the fit linear, and is about as wide as the bounds. But where forces and lengths can explain the
same motion, it is the bounds that decide: each robot's scale has to be within them, which the ratios between robots,
known much better, leave less room for than a Gaussian of the same width.
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
"""Samples within the bounds, below which these contradict the recording."""


def cut_to_bounds(fit: CalibratedFit, tolerances: Tolerances, position_scales: Array) -> CalibratedFit | None:
    """Mean and covariance with errors that are uniform within their bounds; None if they cannot be within.

    Samples of the errors, as the fit has them, are weighted by the uniform prior over the Gaussian one. The inertia
    goes with them, as it is correlated.

    Args:
        fit: With Gaussian errors.
        tolerances: What it was fitted with.
        position_scales: Of each robot, before the fit's scale of all lengths is known, shape (N,).
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
