"""A judge of recordings: noise, filters, single samples, and positions with other axes or units."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from coheft.app.identify.choices import Options
from coheft.app.identify.methods import identify
from coheft.errors import RecordingError
from coheft.estimation.batch.judge.band import white_level
from coheft.estimation.batch.judge.sensors import saturated_sensor, spiking_sensor
from coheft.estimation.batch.recording import Recording
from coheft.estimation.batch.signals import low_pass
from coheft.estimation.geometry.spatial import Array
from tests.estimation.batch_team import held_recording
from tests.estimation.recorded_faults import (
    to_wrench,
    with_fault,
)
from tests.estimation.test_batch_judge import SEED, deviations, judged


def test_without_gravity_nothing_is_judged() -> None:
    assert identify(replace(held_recording(SEED), gravity=np.zeros(3)), Options()).verdict is None


def test_a_sensors_own_filter_does_not_make_it_look_quiet() -> None:
    recording = held_recording(SEED)
    slow = with_fault(recording, to_wrench(lambda wrench: low_pass(wrench, recording.rate, 15.0)), *recording.names)
    assert not judged(slow)[1].is_refuted


def test_noise_is_measured_above_the_motion() -> None:
    rng = np.random.default_rng(1)
    time = np.arange(3000) / 100.0
    samples = 0.3 * rng.normal(size=(3000, 2)) + 50.0 * np.sin(6.0 * time)[:, None]
    np.testing.assert_allclose(white_level(samples, 100.0, 3.0), 0.3, rtol=0.15)
    assert white_level(samples, 15.0, 3.0) is None


def test_results_do_not_depend_on_who_is_first() -> None:
    recording = with_fault(held_recording(SEED), to_wrench(lambda wrench: wrench + [4.0, -3.0, 2.0, 0.0, 0.0, 0.0]))
    turned = replace(recording, robots=dict(reversed(recording.robots.items())), truth=None)
    (_, one), (_, other) = judged(recording), judged(turned)
    assert (one.cause, one.robot) == (other.cause, other.robot)
    assert one.mass is not None
    assert other.mass is not None
    assert other.mass[0] == pytest.approx(one.mass[0], abs=0.2 * one.mass[1])


@pytest.mark.parametrize("to", [0.0, 100.0])
def test_forces_that_jump_for_single_samples_are_named(to: float) -> None:
    def jump(wrench: Array) -> Array:
        wrench[50::97] = to
        return wrench

    _, verdict = judged(with_fault(held_recording(SEED), to_wrench(jump)))
    assert (verdict.cause, verdict.robot) == ("sensor dead", "r2")
    assert "forces of r2 jump for single samples" in verdict.words


@pytest.mark.parametrize("step", [0.0, 1.0])
def test_coarse_and_held_readings_do_not_jump(step: float) -> None:
    def coarse(wrench: Array) -> Array:
        return np.rint(wrench / step) * step if step else wrench[np.arange(len(wrench)) // 5 * 5]

    assert spiking_sensor(with_fault(held_recording(SEED), to_wrench(coarse))) is None


def with_positions(robots: tuple[str, ...], columns: list[int], signs: list[float]) -> Recording:
    recording = held_recording(SEED)
    for name in robots:
        recording = recording.changed("pose", lambda pose: pose[:, [*columns, 3, 4, 5, 6]] * [*signs, 1, 1, 1, 1], name)
    return recording


@pytest.mark.parametrize(
    ("robots", "columns", "signs", "words"),
    [
        (("r2",), [1, 0, 2], [1.0, 1.0, 1.0], "'pose' of r2: .* with positions y x z in place of x y z they can"),
        (("r1", "r2", "r3"), [0, 1, 2], [1.0, 1.0, -1.0], "'pose' of r1, r2, r3: .* with positions x y -z in place"),
    ],
)
def test_positions_with_other_axes_are_named(
    robots: tuple[str, ...], columns: list[int], signs: list[float], words: str
) -> None:
    with pytest.raises(RecordingError, match=words):
        identify(with_positions(robots, columns, signs))


@pytest.mark.parametrize("factor", [1.1, 3.28])
def test_lengths_of_all_robots_in_another_unit_are_named_and_mended(factor: float) -> None:
    scale = np.repeat([factor, 1.0], [3, 4])
    recording = held_recording(SEED).changed("pose", lambda pose: pose * scale)
    _, verdict = judged(recording)
    assert (verdict.cause, verdict.robot) == ("length scale", None)
    assert verdict.value[0] == pytest.approx(factor, rel=0.01)
    assert "lengths of all robots are" in verdict.words
    found = identify(recording, Options(assume="length scale"))
    assert found.doubts == ()
    assert deviations(recording, found).max() < 5.0


@pytest.mark.parametrize(("seed", "robot", "share"), [(SEED, "r1", 0.8), (6, "r2", 0.6), (SEED, "r3", 0.7)])
def test_a_sensor_that_is_saturated_is_named(seed: int, robot: str, share: float) -> None:
    recording = held_recording(seed)
    wrench = recording.robots[robot].wrench
    assert wrench is not None
    limit = float(np.quantile(wrench[:, 2], share))
    clipped = to_wrench(lambda wrench: np.minimum(wrench, [np.inf, np.inf, limit, np.inf, np.inf, np.inf]))
    _, verdict = judged(with_fault(recording, clipped, robot))
    assert (verdict.cause, verdict.robot) == ("sensor dead", robot)
    assert f"readings of {robot} stay at their largest or smallest value, fz at {limit:.4g} N" in verdict.words
    assert "saturated" in verdict.words


@pytest.mark.parametrize("step", [0.1, 1.0, 5.0])
def test_coarse_readings_are_not_saturated(step: float) -> None:
    coarse = to_wrench(lambda wrench: np.rint(wrench / step) * step)
    assert saturated_sensor(with_fault(held_recording(SEED), coarse)) is None


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_a_sensor_that_is_interrupted_is_named(value: float) -> None:
    def interrupted(wrench: Array) -> Array:
        wrench[1000:1090] = value * wrench[1000]
        return wrench

    _, verdict = judged(with_fault(held_recording(SEED), to_wrench(interrupted)))
    assert (verdict.cause, verdict.robot, verdict.value) == ("sensor dead", "r2", (10.0,))
    assert "forces of r2 are exactly the same for 0.9 s from 10.0 s on" in verdict.words
