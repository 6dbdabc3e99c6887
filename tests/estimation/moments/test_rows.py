"""Rows: means that keep the laws of motion linear, and whose noise is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.moments.rows import (
    KINEMATICS,
    PRODUCTS,
    SLOPE,
    TWIST,
    WRENCH,
    RowNoise,
    W,
    row_of_samples,
    row_with_rates,
    rows_per_block,
)
from coheft.estimation.rigid_body.mass_properties import unpack_symmetric
from tests.rigid_motions import vectors

RATE = 500.0


def rows_of_noise(noise: SensorNoise, samples: Array, repeated: int) -> Array:
    """Rows of the same samples (B, 15), each time with other noise."""
    rng = np.random.default_rng(3)
    spread = rng.normal(size=(repeated, *samples.shape)) * noise.per_column()
    return np.array([row_of_samples(samples + each, noise.gyro**2, RATE) for each in spread])


@given(st.integers(2, 20), st.integers(0, 1000))
def test_a_row_holds_means(count: int, seed: int) -> None:
    samples = np.random.default_rng(seed).normal(size=(count, 15))
    row = row_of_samples(samples, 0.0, RATE)
    np.testing.assert_allclose(row[TWIST], samples[:, :6].mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(row[6:9], samples[:, 6:9].mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(row[WRENCH], samples[:, 9:].mean(axis=0), atol=1e-12)
    products = np.mean([np.outer(w, w) for w in samples[:, :3]], axis=0)
    np.testing.assert_allclose(unpack_symmetric(row[PRODUCTS]), products, atol=1e-12)


@given(vectors(3.0), vectors(50.0), st.integers(2, 30), st.floats(20.0, 2000.0))
def test_the_slope_is_that_of_a_line(start: Array, slope: Array, count: int, rate: float) -> None:
    samples = np.zeros((count, 15))
    samples[:, W] = start + np.arange(count)[:, None] / rate * slope
    np.testing.assert_allclose(row_of_samples(samples, 0.0, rate)[SLOPE], slope, atol=1e-9)


def test_the_slope_is_that_of_the_best_line() -> None:
    samples = np.random.default_rng(1).normal(size=(7, 15))
    slope = np.polyfit(np.arange(7) / RATE, samples[:, W], 1)[0]
    np.testing.assert_allclose(row_of_samples(samples, 0.0, RATE)[SLOPE], slope, rtol=1e-9)


def test_noise_of_rows_is_as_claimed() -> None:
    noise, repeated = SensorNoise(0.2, 0.3, 0.4, 0.5, 0.6), 20_000
    found = rows_of_noise(noise, np.zeros((5, 15)), repeated)
    claimed = RowNoise.of_samples(noise, 5, RATE)
    tolerance = 4.0 / math.sqrt(2.0 * repeated)
    np.testing.assert_allclose(found[:, KINEMATICS].std(axis=0), claimed.kinematics[0], rtol=tolerance)
    np.testing.assert_allclose(found[:, WRENCH].std(axis=0), claimed.wrench[0], rtol=tolerance)
    correlation = np.corrcoef(found[:, :18].T) - np.eye(18)  # slope and mean of one gyro are independent
    assert np.abs(correlation).max() < 5.0 / math.sqrt(repeated)


@pytest.mark.parametrize("correlation", [0.0, 0.01, 0.1])
def test_noise_of_rows_and_of_their_rates_is_as_claimed_if_it_is_slow(correlation: float) -> None:
    size, number, repeated, rng = 5, 400, 200, np.random.default_rng(2)
    alike = math.exp(-1.0 / (correlation * RATE)) if correlation else 0.0
    white = rng.normal(size=(repeated, size * number + 2, 2))
    noise = np.empty_like(white)
    noise[:, 0] = white[:, 0]
    for k in range(1, noise.shape[1]):
        noise[:, k] = alike * noise[:, k - 1] + math.sqrt(1.0 - alike**2) * white[:, k]
    claimed = RowNoise.of_samples(SensorNoise(1.0, 1.0, 1.0, 1.0, 1.0), size, RATE, correlation)
    samples, rows = np.zeros((size + 2, 15)), np.empty((repeated, number, 48))
    for run in range(repeated):
        for k in range(number):
            samples[:, [0, 9]] = noise[run, k * size : k * size + size + 2]
            rows[run, k] = row_with_rates(samples, 0.0, RATE)
    by_itself = np.concatenate([claimed.kinematics[0], claimed.wrench[0]]) / math.sqrt(claimed.slowness)
    for index in (W.start, SLOPE.start, WRENCH.start):
        assert rows[..., index].std() == pytest.approx(by_itself[index], rel=0.05)
        assert rows[..., 24 + index].std() == pytest.approx(by_itself[index] * claimed.rates[0, index], rel=0.05)
        # Beside the row its rate is noise of its own.
        together = np.mean(rows[..., index] * rows[..., 24 + index])
        assert abs(together) < 0.02 * rows[..., index].std() * rows[..., 24 + index].std()
    for index in (W.start, WRENCH.start):
        spread = math.sqrt(number) * rows[..., index].mean(axis=1).std()
        assert spread == pytest.approx(by_itself[index] * math.sqrt(claimed.slowness), rel=0.2)


@pytest.mark.parametrize("duration", [0.02, 0.1])
def test_what_a_slope_is_not_counts_as_noise(duration: float) -> None:
    samples, frequency, turning = round(duration * RATE), 2.0, 10.0
    time = (np.arange(samples) - 0.5 * (samples - 1)) / RATE
    motion = np.zeros((samples, 15))
    motion[:, W] = (turning / (2.0 * np.pi * frequency) * np.sin(2.0 * np.pi * frequency * time))[:, None]
    mean = turning * np.mean(np.cos(2.0 * np.pi * frequency * time))
    wrong = np.abs(row_of_samples(motion, 0.0, RATE)[SLOPE] - mean).max()
    claimed = RowNoise.of_samples(SensorNoise(gyro=1e-9), samples, RATE).kinematics[0, SLOPE]
    assert (wrong < claimed).all()
    assert (claimed < 10.0 * wrong).all()


def test_noise_adds_nothing_to_products_on_the_average() -> None:
    noise, repeated = SensorNoise(gyro=0.2), 20_000
    samples = np.zeros((5, 15))
    samples[:, W] = [0.3, -0.5, 0.1]
    found = rows_of_noise(noise, samples, repeated)[:, PRODUCTS]
    deviations = (found.mean(axis=0) - row_of_samples(samples, 0.0, RATE)[PRODUCTS]) / found.std(axis=0)
    assert np.abs(deviations).max() < 4.0 / math.sqrt(repeated)


@given(st.integers(1, 400), st.floats(10.0, 5000.0), st.floats(0.005, 0.2))
def test_a_block_is_cut_into_the_fewest_rows_that_are_short_enough(samples: int, rate: float, longest: float) -> None:
    count = rows_per_block(samples, rate, longest)
    assert samples % count == 0
    possible = [n for n in range(1, samples + 1) if samples % n == 0 and samples // n >= min(2, samples)]
    short = [n for n in possible if samples / n / rate <= longest * (1.0 + 1e-6)]
    assert count in possible
    assert count == (min(short) if short else max(possible))


@pytest.mark.parametrize(("samples", "rate", "count"), [(20, 500.0, 2), (10, 500.0, 1), (11, 500.0, 1), (10, 100.0, 5)])
def test_common_blocks(samples: int, rate: float, count: int) -> None:
    assert rows_per_block(samples, rate) == count
