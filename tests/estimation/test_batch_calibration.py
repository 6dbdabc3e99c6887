"""Calibration errors that are uniform within bounds."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.estimation.batch.calibrated_fit import CalibratedFit, cut_to_bounds
from coheft.estimation.batch.wrist_poses import UNIFORM_BOUND, Tolerances
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.rigid_body.regressor import INERTIA_SIZE

COUNT = 3
BOUND = 0.03
TOLERANCES = Tolerances.of_bounds(1.0, 0.01, BOUND, 0.01, 0.5)
SPREAD = TOLERANCES.motion_errors(COUNT)
NOTHING = 1e6
"""Standard deviation over that of before, of what was not seen at all."""


def fit(told: Array, noise: Array) -> CalibratedFit:
    """A fit of errors that were told with this noise, beside a Gaussian of before; all mass is a wrong first force."""
    information = noise**-2 + SPREAD**-2
    before = np.concatenate([[1.0], np.zeros(len(SPREAD) - 1)])
    errors = before + (told - before) * noise**-2 / information
    derivative = np.zeros((INERTIA_SIZE, len(SPREAD)))
    derivative[0, 1] = -8.0
    covariance = np.diag(np.concatenate([np.full(INERTIA_SIZE, 1e-6), 1.0 / information]))
    covariance[:INERTIA_SIZE, INERTIA_SIZE:] = derivative / information
    covariance[INERTIA_SIZE:, :INERTIA_SIZE] = covariance[:INERTIA_SIZE, INERTIA_SIZE:].T
    covariance[:INERTIA_SIZE, :INERTIA_SIZE] += derivative @ np.diag(1.0 / information) @ derivative.T
    numbers = np.concatenate([derivative @ (errors - before), errors])
    shown = np.diag(noise**-2 / information)
    return CalibratedFit(numbers, covariance, shown, noise**2 * shown**2, np.zeros((1, 6)), np.ones(6))


def told(**changes: float) -> Array:
    result = np.concatenate([[1.0], np.zeros(len(SPREAD) - 1)])
    for key, value in changes.items():
        result[int(key[1:])] = value
    return result


def test_what_was_not_seen_is_uniform_again() -> None:
    found = cut_to_bounds(fit(told(), NOTHING * SPREAD), TOLERANCES, np.zeros(COUNT))
    assert found is not None
    std = np.sqrt(np.diag(found.covariance))[INERTIA_SIZE:]
    # Of 65536 samples in 13 dimensions some hundreds count.
    np.testing.assert_allclose(std[1:], SPREAD[1:], rtol=0.15)
    # Three equal robots have one scale, which is as uniform as each of theirs.
    assert std[0] == pytest.approx(TOLERANCES.position_scale, rel=0.15)
    assert np.sqrt(found.covariance[0, 0]) == pytest.approx(8.0 * std[1], rel=0.02)


def test_ratios_of_scales_tell_where_all_of_them_have_to_be() -> None:
    """The largest is at most at its bound, and so is the smallest: the middle between them is the best guess."""
    ratios = np.array([-0.02, 0.0, 0.03])
    found = cut_to_bounds(fit(told(), NOTHING * SPREAD), TOLERANCES, ratios)
    assert found is not None
    lower, upper = 1.03 / (1.0 + BOUND), 0.98 / (1.0 - BOUND)
    width = upper - lower
    assert found.scale == pytest.approx((lower + upper) / 2.0, abs=0.1 * width)
    assert np.sqrt(found.covariance[INERTIA_SIZE, INERTIA_SIZE]) == pytest.approx(width / np.sqrt(12.0), rel=0.15)


def test_what_was_seen_is_cut_at_its_bound_and_the_mass_goes_with_it() -> None:
    """A force scale that was told to be at its bound is half a normal distribution inside."""
    bound, noise = UNIFORM_BOUND * TOLERANCES.force_scale, NOTHING * SPREAD
    noise[1] = 0.1 * bound
    found = cut_to_bounds(fit(told(_1=bound), noise), TOLERANCES, np.zeros(COUNT))
    assert found is not None
    inside = noise[1] * np.sqrt(2.0 / np.pi)
    assert found.force_scale[0] == pytest.approx(bound - inside, abs=0.1 * noise[1])
    assert found.parameters[0] == pytest.approx(-8.0 * (bound - inside), abs=0.8 * noise[1])
    assert np.sqrt(found.covariance[11, 11]) == pytest.approx(noise[1] * np.sqrt(1.0 - 2.0 / np.pi), rel=0.15)
    assert np.sqrt(found.covariance[0, 0]) == pytest.approx(8.0 * np.sqrt(found.covariance[11, 11]), rel=0.15)


def test_what_cannot_be_within_bounds_is_said_so() -> None:
    noise = NOTHING * SPREAD
    noise[5] = 0.05
    assert cut_to_bounds(fit(told(_5=1.0), noise), TOLERANCES, np.zeros(COUNT)) is None
    assert cut_to_bounds(fit(told(), NOTHING * SPREAD), TOLERANCES, np.array([-0.1, 0.0, 0.1])) is None


def test_robots_without_errors_keep_none() -> None:
    exact = Tolerances.of_bounds(0.0, 0.0, 0.0, 0.0, 0.0)
    start = fit(told(), 1e-9 * np.ones(len(SPREAD)))
    found = cut_to_bounds(start, exact, np.zeros(COUNT))
    assert found is not None
    np.testing.assert_allclose(found.numbers, start.numbers, atol=1e-7)
