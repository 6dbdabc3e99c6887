"""Recordings are judged alike, by whatever method they are identified."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.drawn_recordings import Team, draw_team, recorded
from benchmarks.recording_faults import LISTED, faulty
from benchmarks.recordings import deviations, try_recording
from coheft.app.identify.choices import Method, Options
from coheft.app.identify.methods import identify
from coheft.estimation.batch.recording import Recording
from coheft.estimation.geometry.spatial import Array
from tests.estimation.batch_team import held_recording

SEED = 3
OFFSET = np.array([4.0, -3.0, 2.0, 0.0, 0.0, 0.0])
OF_TWISTS: tuple[Method, ...] = ("likelihood", "instruments")


@pytest.fixture(scope="module")
def team() -> Team:
    return draw_team(SEED)


@pytest.fixture(scope="module")
def of_twists(team: Team) -> Recording:
    return recorded(team, "white", by_twists=True)


def with_wrench(recording: Recording, name: str, wrench: Array) -> Recording:
    return replace(recording, robots={**recording.robots, name: replace(recording.robots[name], wrench=wrench)})


def wrench_of(recording: Recording, name: str) -> Array:
    wrench = recording.robots[name].wrench
    assert wrench is not None
    return wrench


@pytest.mark.parametrize("method", OF_TWISTS)
def test_good_recordings_of_twists_are_accepted(method: Method, of_twists: Recording) -> None:
    found = identify(of_twists, Options(method=method))
    assert found.verdict is not None
    assert found.doubts == ()
    assert deviations(of_twists, found) < 5.0


@pytest.mark.parametrize("method", OF_TWISTS)
def test_a_sensor_that_was_not_tared_is_named_without_poses(method: Method, of_twists: Recording) -> None:
    wrong = with_wrench(of_twists, "r2", wrench_of(of_twists, "r2") + OFFSET)
    found = identify(wrong, Options(method=method))
    assert found.verdict is not None
    assert (found.verdict.cause, found.verdict.robot) == ("offset", "r2")
    assert found.doubts == (found.verdict.words,)  # what else is odd comes of it
    assumed = identify(wrong, Options(method=method, assume="offset"))
    assert assumed.doubts == ()
    assert deviations(wrong, assumed) < 5.0


def test_twists_that_repeat_themselves_are_named(of_twists: Recording) -> None:
    robot = of_twists.robots["r1"]
    assert robot.twist is not None
    half = len(robot.twist) // 2
    stuck = np.vstack([robot.twist[:half], np.tile(robot.twist[half], (len(robot.twist) - half, 1))])
    wrong = replace(of_twists, robots={**of_twists.robots, "r1": replace(robot, twist=stuck)})
    verdict = identify(wrong, Options(method="instruments")).verdict
    assert verdict is not None
    assert (verdict.cause, verdict.robot) == ("sensor dead", "r1")


def test_poses_with_twists_beside_them_are_judged(team: Team, of_twists: Recording) -> None:
    poses = recorded(team, "white", by_twists=False)
    robots = {name: replace(robot, pose=poses.robots[name].pose) for name, robot in of_twists.robots.items()}
    both = replace(of_twists, robots=robots)
    assert identify(both, Options()).doubts == ()
    verdict = identify(with_wrench(both, "r2", wrench_of(both, "r2") + OFFSET), Options()).verdict
    assert verdict is not None
    assert (verdict.cause, verdict.robot) == ("offset", "r2")


def test_what_is_too_short_to_be_judged_is_said() -> None:
    team = draw_team(SEED)
    short = recorded(team, "white", by_twists=True).between(0.0, 4.5)
    found = identify(short, Options(method="likelihood"))
    assert found.verdict is None
    assert any(remark.startswith("Not judged: ") for remark in found.remarks)


def test_whose_moments_are_in_another_unit_is_named() -> None:
    """Where other robots' moments are small, all may be thought of as too large: but then sensors are not alike."""
    recording = held_recording(4)
    for name in recording.names:
        small = wrench_of(recording, name) * np.repeat([1.0, 1e3 if name == "r2" else 1.0], 3)
        recording = with_wrench(recording, name, small)
    verdict = identify(recording, Options()).verdict
    assert verdict is not None
    assert (verdict.cause, verdict.robot) == ("moment scale", "r2")


@pytest.mark.slow
@pytest.mark.parametrize("index", range(len(LISTED)))
def test_every_listed_fault_is_refuted_or_harmless(index: int) -> None:
    trial = try_recording("listed", 2 * index + 1001)
    assert trial.is_refuted or (trial.off is not None and trial.off < 5.0), trial
    if trial.is_right is not None and trial.margin > 10.0:
        assert trial.is_right[0], trial


def test_faults_do_what_they_say() -> None:
    case = faulty("dead", 5, by_twists=False)
    assert case.robot is not None
    assert np.abs(wrench_of(case.recording, case.robot)).max() < 0.1
