"""Noise that is larger than is said, and innovations that do not fit."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.estimation.cart.filter import MotionMeasurement
from coheft.estimation.cart.jump import JumpTest
from coheft.estimation.cart.noise import WhiteNoise, misfit

FREEDOM = 7


@pytest.mark.parametrize(("factor", "least", "most"), [(1.0, 1.0, 1.0), (3.0, 2.0, 4.2)])
def test_levels_are_those_of_the_noise_whatever_the_motion(factor: float, least: float, most: float) -> None:
    """A cart that speeds up and loses a fifth of its speed at once."""
    rng, noise = np.random.default_rng(1), WhiteNoise()
    for index in range(300):
        time, jolt = 0.01 * index, -0.4 if index > 150 else 0.0
        motion = np.array([0.5 * time**2, 0.1 * time, 0.1 * time, time + jolt, 0.1, 0.3 * np.sin(time)])
        noise.see(MotionMeasurement(motion + factor * 0.005 * rng.standard_normal(6), 2.5e-5 * np.eye(6)))
    assert (noise.levels >= least).all()
    assert (noise.levels <= most).all()


def test_steps_are_repeated_for_noise_that_has_clearly_risen_only() -> None:
    rng, noise = np.random.default_rng(5), WhiteNoise()
    factors = np.repeat([1.0, 3.0, 1.0, 3.0], 600)
    risen = [noise.see(MotionMeasurement(factor * rng.standard_normal(6), np.eye(6))) for factor in factors]
    at = np.flatnonzero(risen)
    assert (np.bincount(at // 600, minlength=4)[[1, 3]] > 0).all()
    assert len(at) < 24


def test_independent_innovations_fit_and_lasting_ones_do_not() -> None:
    rng, never = np.random.default_rng(2), np.ones(6)
    white = rng.standard_normal((600, 6))
    np.testing.assert_array_equal(misfit(white, never), never)
    lasting = white.copy()
    lasting[:, 5] += 0.5
    found = misfit(lasting, never)
    np.testing.assert_array_equal(found[:5], 1.0)
    assert found[5] == pytest.approx(4.1, abs=0.5)  # 64 of them add up to 32, where chance has 8


def test_a_misfit_that_is_gone_is_forgotten() -> None:
    white = np.random.default_rng(3).standard_normal((600, 6))
    assert (misfit(white / 3.0, 3.0 * np.ones(6)) < 1.5).all()


def test_a_jump_stands_out_from_what_is_usual() -> None:
    """Where all innovations are four times as large as they should be, one more of these is no jump."""
    rng = np.random.default_rng(4)
    usual = list(rng.chisquare(FREEDOM, 200))
    loud = [4.0 * each for each in usual]
    assert JumpTest(FREEDOM).changed_since(usual) == 0
    assert JumpTest(FREEDOM).changed_since(loud) == 0
    assert JumpTest(FREEDOM).changed_since([80.0, *usual]) == 1
    assert JumpTest(FREEDOM).changed_since([80.0, *loud]) == 0
    assert JumpTest(FREEDOM).changed_since([400.0, *loud]) == 1
