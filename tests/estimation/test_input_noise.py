"""How noisy sums are, measured from samples of a smooth motion."""

from __future__ import annotations

import numpy as np

from coheft.estimation.fan2017.angular_acceleration import gyro_derivative
from coheft.estimation.fan2017.input_noise import InputNoise
from coheft.estimation.geometry.spatial import Array

RATE, BLOCK = 500.0, 10
GUESS = np.diag(np.repeat([0.01, 0.02, 0.03, 0.04], 3))


def motion(blocks: int) -> Array:
    """Much larger than noise, at 1.6 Hz and its double."""
    times = np.arange(blocks * BLOCK) / RATE
    phases = np.arange(12)
    signal: Array = 50.0 * np.sin(10.0 * times[:, None] + phases) + 20.0 * np.sin(20.0 * times[:, None] + 2.0 * phases)
    return signal


def measured(samples: Array) -> InputNoise:
    result = InputNoise(GUESS)
    for start in range(0, len(samples), BLOCK):
        result.measure(samples[start : start + BLOCK])
    return result


def test_white_noise_is_measured_with_its_correlations() -> None:
    rng, blocks = np.random.default_rng(1), 3000
    root = 0.05 * rng.normal(size=(12, 12))
    found = measured(motion(blocks) + rng.normal(size=(blocks * BLOCK, 12)) @ root.T)
    truth = root @ root.T
    np.testing.assert_allclose(found.covariance, truth, atol=0.1 * truth.diagonal().max())


def test_noise_of_a_differentiated_gyro_is_measured_as_large_as_it_is() -> None:
    rng, blocks, gyro = np.random.default_rng(2), 3000, 0.005
    samples, gyros = motion(blocks), gyro * rng.normal(size=(blocks * BLOCK + 2, 3))
    samples[:, 9:] += gyro_derivative(gyros[0], gyros[1:-1], gyros[-1], RATE)
    found = measured(samples).covariance.diagonal()[9:]
    np.testing.assert_allclose(found, 0.5 * (gyro * RATE) ** 2, rtol=0.1)


def test_it_is_positive_from_the_first_block_on() -> None:
    """However much a few samples seem to be correlated."""
    rng = np.random.default_rng(3)
    for _ in range(100):
        found = InputNoise(1e-4 * GUESS)
        found.measure(rng.normal(size=(BLOCK, 12)) @ rng.normal(size=(12, 12)))
        assert np.linalg.eigvalsh(found.covariance).min() > 0.0


def test_the_guess_holds_where_blocks_are_too_short_to_tell() -> None:
    noise = InputNoise(GUESS)
    noise.measure(np.random.default_rng(4).normal(size=(8, 12)))
    np.testing.assert_array_equal(noise.covariance, GUESS)


def test_the_jump_of_a_load_change_is_no_noise() -> None:
    rng, blocks = np.random.default_rng(5), 200
    samples = motion(blocks) + rng.normal(size=(blocks * BLOCK, 12))
    noise = measured(samples)
    before = noise.covariance.copy()
    jump = samples[:BLOCK].copy()
    jump[BLOCK // 2 :, :3] += 30.0
    noise.measure(jump)
    np.testing.assert_array_equal(noise.covariance, before)
