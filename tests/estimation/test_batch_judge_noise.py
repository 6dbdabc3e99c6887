"""A judge of recordings: noise that is not white, or that forces and moments have in common."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.estimation.batch.judge.band import correlations
from coheft.estimation.geometry.spatial import Array
from tests.estimation.batch_team import held_recording
from tests.estimation.recorded_faults import to_wrench, with_fault
from tests.estimation.test_batch_judge import SEED, judged


def test_moments_of_all_about_another_point_show_in_a_slow_motion() -> None:
    """Their noise is that of the forces by which they were computed."""

    def moved(wrench: Array) -> Array:
        return np.hstack([wrench[:, :3], wrench[:, 3:] + np.cross([0.0, 0.0, 0.08], wrench[:, :3])])

    recording = held_recording(SEED, seconds=60.0, speed=0.2)
    _, verdict = judged(with_fault(recording, to_wrench(moved), *recording.names))
    assert verdict.cause == "lever"
    assert "all robots" in verdict.candidates


def test_noise_in_common_is_found() -> None:
    rng = np.random.default_rng(0)
    one, other, third = rng.normal(size=(3, 3000))
    time = np.arange(3000) / 100.0
    line = 5.0 * np.sin(2.0 * np.pi * 5.0 * time)
    samples = np.stack([one, 0.6 * one + 0.8 * other, third + line, other + line], axis=-1)
    found = correlations(samples, 100.0, 3.0)
    assert found[0, 1] == pytest.approx(0.6, abs=0.15)
    assert found[1, 3] == pytest.approx(0.8, abs=0.15)
    np.testing.assert_allclose([found[0, 2], found[0, 3], found[2, 3]], 0.0, atol=1e-9)  # not by a line alone
    assert np.linalg.eigvalsh(found).min() > 0.0
