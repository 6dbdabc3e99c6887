"""A judge of recordings: clocks that are off by more than the motion's time scale, and robots that turn otherwise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from coheft.app.identify.choices import Options
from coheft.app.identify.methods import identify
from coheft.app.identify.report import make_report
from coheft.errors import RecordingError
from coheft.estimation.batch.recording import Recording, RobotRecord
from coheft.estimation.geometry.spatial import Array
from tests.estimation.batch_team import RATE, exact_signals, grasps, held_recording
from tests.estimation.test_batch_judge import SEED, deviations, judged

LONGEST = 400
"""Samples by which clocks are off at most."""


def off(recording: Recording, samples: int) -> Recording:
    """The same with the second robot late by so many samples, all of its sensors alike."""
    count = len(recording.time) - 2 * LONGEST
    robots = {}
    for name, robot in recording.robots.items():
        first = LONGEST - (samples if name == "r2" else 0)
        channels = {channel: values[first : first + count] for channel, values in robot.channels.items()}
        robots[name] = RobotRecord(recording.time[:count], **channels)
    return replace(recording, robots=robots)


@pytest.mark.parametrize(
    ("samples", "count", "robot", "words"),
    [
        (60, 3, "r2", "poses of r2 are 600 ms late against the others'"),
        (-60, 3, "r2", "poses of r2 are 600 ms early against the others'"),
        (LONGEST, 3, "r2", "poses of r2 are 4 s late against the others'"),
        (100, 3, "r2", "poses of r2 are 1 s late against the others'"),
        (80, 2, None, "poses of r2 are (or those of the other robot, the other way round) 800 ms late"),
    ],
)
def test_a_clock_that_is_far_off_is_named(samples: int, count: int, robot: str | None, words: str) -> None:
    recording = off(held_recording(SEED, count, 33.0), samples)
    found, verdict = judged(recording)
    assert (verdict.cause, verdict.robot) == ("clock", robot)
    assert verdict.value[0] == pytest.approx(samples / 100.0, abs=0.005)
    assert words in verdict.words
    assert not any("turn the load" in text for text in make_report("far.npz", recording, found).not_observable)


@pytest.mark.parametrize("samples", [60, -LONGEST])
def test_a_clock_that_is_far_off_is_corrected(samples: int) -> None:
    recording = off(held_recording(SEED, 3, 33.0), samples)
    found = identify(recording, Options(assume="clock"))
    assert found.doubts == ()
    assert deviations(recording, found).max() < 5.0


def test_a_delay_of_a_motion_that_repeats_itself_is_one_of_several() -> None:
    """Angular speeds repeat themselves each second."""
    time, rng = np.arange(int(38.0 * RATE)) / RATE, np.random.default_rng(3)
    motion = np.zeros((len(time), 12))
    motion[:, :3] = np.cos(np.pi * time[:, None] + [0.0, 1.0, 2.0]) * [0.4, 0.3, 0.2]
    motion[:, 9:] = -np.pi * np.sin(np.pi * time[:, None] + [0.0, 1.0, 2.0]) * [0.4, 0.3, 0.2]
    motion[:, 8] = 9.81
    signals = exact_signals(rng, grasps(rng), motion=motion)
    robots = {}
    for k, wrench in enumerate(signals.wrench):
        own = np.hstack([signals.motion[k, :, :9], wrench]) + 1e-3 * rng.normal(size=(len(time), 15))
        robots[f"r{k + 1}"] = RobotRecord(time, twist=own[:, :6], acceleration=own[:, 6:9], wrench=own[:, 9:])
    recording = off(Recording(robots), 60)
    _, verdict = judged(recording)
    assert "twists of r2 are 400 ms early (or 600 ms late, 1.4 s early, …: the motion repeats itself)" in verdict.words
    with pytest.raises(RecordingError, match="nothing says whose readings to correct, or how"):
        identify(recording, Options(assume="clock"))


def test_a_robot_that_turns_otherwise_is_named() -> None:
    """Samples were left out without a trace in its times."""
    recording = held_recording(SEED)
    every = recording.robots["r2"].channels
    kept = [k for k in range(len(recording.time)) if k % 8]
    count = len(kept)
    robots = {
        name: RobotRecord(recording.time[:count], **{c: v[:count] for c, v in robot.channels.items()})
        for name, robot in recording.robots.items()
    }
    robots["r2"] = RobotRecord(recording.time[:count], **{channel: values[kept] for channel, values in every.items()})
    left_out = replace(recording, robots=robots)
    found, verdict = judged(left_out)
    assert verdict.cause == "unknown"
    assert "r2 does not turn as the others do" in verdict.words
    assert not any("about other axes" in text for text in make_report("out.npz", left_out, found).not_observable)


def test_one_that_hardly_turns_is_not_suspected() -> None:
    """Angular speeds of noise do not correlate."""
    found = identify(held_recording(SEED, turns=(0.001, 0.001, 0.001)), Options())
    assert found.verdict is None
    assert found.not_judged


@pytest.mark.parametrize("turns", [(0.0, 0.0, 0.1), (0.03, 0.03, 0.03)])
def test_a_robot_with_more_noise_than_the_others_is_not_suspected(turns: tuple[float, float, float]) -> None:
    """Its angular speeds do not correlate with the others', which do with each other."""
    rng = np.random.default_rng(1)

    def noisy(pose: Array) -> Array:
        turned = Rotation.from_quat(pose[:, 3:]) * Rotation.from_rotvec(0.01 * rng.normal(size=(len(pose), 3)))
        return np.hstack([pose[:, :3], turned.as_quat()])

    found = identify(held_recording(SEED, turns=turns).changed("pose", noisy, "r3"), Options())
    assert found.verdict is None
    assert found.not_judged
