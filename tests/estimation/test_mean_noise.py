"""How much of one robot's noise the mean of all robots' estimates leaves."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from coheft.estimation.fan2017.mean_noise import MeanNoise
from coheft.estimation.geometry.spatial import Array

MEMORY = 50.0
DECAY = 1.0 - 1.0 / MEMORY


@dataclass
class _Own:
    """All that is asked of a ``JointRls``."""

    noise_root: Array
    gain: Array = field(default_factory=lambda: np.eye(10))
    decay: float = DECAY


def measure(noise: MeanNoise, pull: Array, own: _Own) -> None:
    noise.measure(pull, own)  # type: ignore[arg-type]


def roots(rng: np.random.Generator) -> tuple[Array, Array]:
    """Of what a block does to the mean, and of the covariance of the own estimate, in units as different as theirs."""
    scales = np.geomspace(1e-5, 10.0, 10)[:, None]
    own = scales * rng.normal(size=(10, 10))
    return scales * rng.normal(size=(10, 10)), np.linalg.cholesky(own @ own.T)


def test_the_covariance_of_the_mean_is_that_of_its_moves() -> None:
    rng, noise = np.random.default_rng(1), MeanNoise(MEMORY)
    move, root = roots(rng)
    for _ in range(4000):
        measure(noise, move @ rng.normal(size=10), _Own(root))
    expected = move @ move.T / (1.0 - DECAY**2)
    found = root @ noise.share @ root.T
    sizes = np.sqrt(expected.diagonal())
    np.testing.assert_allclose(found / np.outer(sizes, sizes), expected / np.outer(sizes, sizes), atol=0.15)


def test_former_residuals_count_by_the_gain_of_today() -> None:
    rng, noise = np.random.default_rng(1), MeanNoise(MEMORY)
    _, root = roots(rng)
    for block in range(4000):  # information comes and goes, and the own covariance with it
        gain = (2.0 + np.sin(0.1 * block)) * root
        measure(noise, rng.normal(size=10), _Own(gain, gain))
    np.testing.assert_allclose(noise.share, np.eye(10) / (1.0 - DECAY**2), atol=0.15 / (1.0 - DECAY**2))


def test_before_it_is_measured_the_mean_is_taken_to_be_as_noisy_as_one() -> None:
    rng, noise = np.random.default_rng(2), MeanNoise(MEMORY)
    move, root = roots(rng)
    for _ in range(int(MEMORY) - 1):
        measure(noise, move @ rng.normal(size=10), _Own(root))
    np.testing.assert_array_equal(noise.share, np.eye(10))


@pytest.mark.parametrize("late", [0, 8])
def test_what_a_load_change_does_is_no_noise(late: int) -> None:
    rng, noise = np.random.default_rng(3), MeanNoise(MEMORY)
    move, root = roots(rng)
    for _ in range(200):
        measure(noise, move @ rng.normal(size=10), _Own(root))
    before = noise.share.copy()
    noise.pause(late)
    for _ in range(late + 1):  # of the blocks before, and of the surprising one
        measure(noise, 1e3 * move @ rng.normal(size=10), _Own(root))
    for _ in range(200):
        measure(noise, move @ rng.normal(size=10), _Own(root))
    assert np.trace(noise.share) < 1.5 * np.trace(before)
