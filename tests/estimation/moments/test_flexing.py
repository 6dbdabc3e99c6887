"""How fast forces change in axes that do not turn, against forces whose derivatives are known."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.estimation.geometry.spatial import Array, rotation_exp
from coheft.estimation.measurement import FORCE, GYRO, SensorNoise
from coheft.estimation.moments.rows import RowNoise, flexing, flexing_margin

PHASES = np.array([0.3, 1.7, 2.9])
SIZES = pytest.mark.parametrize(("rate", "row"), [(1000.0, 20), (500.0, 10), (100.0, 2), (500.0, 50)])


def turning_robot(rate: float, row: int, frequency: float, turn: Array) -> tuple[Array, Array]:
    """Samples of a robot that turns with ``turn`` (3,) [rad/s], whose force swings in the world; and exact results."""
    margin, omega = flexing_margin(rate), 2.0 * np.pi * frequency
    time = (np.arange(row + 2 * margin) - 0.5 * (row + 2 * margin - 1)) / rate
    force = 30.0 + 20.0 * np.sin(omega * time[:, None] + PHASES)
    samples = np.zeros((len(time), 15))
    samples[:, GYRO] = turn
    samples[:, FORCE] = (rotation_exp(-time[:, None] * turn) @ force[..., None])[..., 0]
    return samples, 20.0 * np.concatenate([omega * np.cos(PHASES), -(omega**2) * np.sin(PHASES)])


@SIZES
@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (1.0, -2.0, 0.5)])
def test_forces_that_swing_in_the_world_change_as_they_do_there(rate: float, row: int, turn: Array) -> None:
    for frequency in (0.0, 0.4, 1.6):
        samples, expected = turning_robot(rate, row, frequency, np.array(turn))
        found = flexing(samples, flexing_margin(rate), rate)
        scale = np.repeat([20.0 * 2.0 * np.pi * max(frequency, 0.4)], 6) * np.repeat([1.0, 10.0], 3)
        np.testing.assert_allclose(found / scale, expected / scale, atol=0.004 if row / rate < 0.05 else 0.02)


@SIZES
def test_noise_is_as_claimed_and_independent_of_the_row_s_mean(rate: float, row: int) -> None:
    margin, repeated, rng = flexing_margin(rate), 4000, np.random.default_rng(1)
    claimed = RowNoise.of_samples(SensorNoise(force=0.5), row, rate)
    found, means = np.empty((repeated, 6)), np.empty((repeated, 3))
    for k in range(repeated):
        samples = np.zeros((row + 2 * margin, 15))
        samples[:, FORCE] = 0.5 * rng.normal(size=(len(samples), 3))
        found[k] = flexing(samples, margin, rate)
        means[k] = samples[margin : margin + row, FORCE].mean(axis=0)
    np.testing.assert_allclose(found.std(axis=0), claimed.flexing * claimed.wrench[0, :3].mean(), rtol=0.05)
    correlation = np.corrcoef(np.hstack([found, means]).T) - np.eye(9)
    assert np.abs(correlation).max() < 5.0 / np.sqrt(repeated)
