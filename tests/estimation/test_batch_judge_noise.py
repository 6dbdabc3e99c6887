"""A judge of recordings: noise that is not white, or that forces and moments have in common."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from coheft.estimation.batch.judge.band import correlations
from coheft.estimation.geometry.spatial import Array
from tests.estimation.batch_team import HELD_NOISE, RATE, held_recording
from tests.estimation.recorded_faults import Fault, late, to_wrench, with_fault
from tests.estimation.test_batch_assumed import tabled_deviations
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


def coloured(time_constant: float, seed: int) -> Fault:
    """With more noise, as large as the white one, but correlated over this time [s]."""
    rng, kept = np.random.default_rng(seed), np.exp(-1.0 / RATE / time_constant)

    def noisy(wrench: Array) -> Array:
        steps = np.sqrt(1.0 - kept**2) * rng.normal(size=wrench.shape) * np.repeat(HELD_NOISE[2:], 3)
        result: Array = wrench + lfilter([1.0], [1.0, -kept], steps, axis=0)
        return result

    return to_wrench(noisy)


@pytest.mark.parametrize(("time_constant", "seed"), [(0.05, 1), (0.1, 3), (0.3, 1), (0.3, 3), (1.0, 5)])
def test_noise_that_is_correlated_over_time_is_no_fault(seed: int, time_constant: float) -> None:
    recording = held_recording(seed)
    recording = with_fault(recording, coloured(time_constant, seed), *recording.names)
    found, verdict = judged(recording)
    assert not verdict.is_refuted, verdict.words
    assert tabled_deviations(recording, found).max() < 5.0
    assert any(remark.startswith("Noise of wrenches is not white, but correlated over") for remark in found.remarks)


@pytest.mark.parametrize(
    ("fault", "cause"),
    [(to_wrench(lambda wrench: wrench + [2.0, -1.0, 1.5, 0.0, 0.0, 0.0]), "offset"), (to_wrench(late), "clock")],
)
def test_a_fault_is_not_taken_for_such_noise(fault: Fault, cause: str) -> None:
    recording = held_recording(2)
    recording = with_fault(with_fault(recording, coloured(0.1, 2), *recording.names), fault)
    _, verdict = judged(recording)
    assert (verdict.cause, verdict.robot) == (cause, "r2")


@pytest.mark.parametrize("seed", [0, 1])
def test_what_happens_once_is_no_noise(seed: int) -> None:
    burst = np.exp(-(((np.arange(2500) / RATE - 12.0) / 0.3) ** 2))[:, None] * np.repeat([4.0, 0.3], 3)
    _, verdict = judged(with_fault(held_recording(seed), to_wrench(lambda wrench: wrench + burst)))
    assert verdict.cause == "unknown"
