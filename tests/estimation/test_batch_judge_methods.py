"""Recordings are judged alike, by whatever method they are identified."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from benchmarks.drawn_recordings import KINDS, Team, draw_team, recorded
from benchmarks.recording_faults import LISTED, faulty
from benchmarks.recordings import deviations, try_recording
from coheft.app.identify.choices import Method, Options
from coheft.app.identify.methods import fitted, identify
from coheft.errors import RecordingError
from coheft.estimation.batch.plausibility import check_twists
from coheft.estimation.batch.recording import Recording
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import SensorNoise
from tests.estimation.batch_team import (
    RATE,
    exact_signals,
    grasps,
    held_recording,
    sensors_recording,
    sliding,
)
from tests.estimation.team import body_motion

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


def test_a_gyro_that_does_not_work_is_named(of_twists: Recording) -> None:
    wrong = of_twists.changed("twist", lambda twist: twist * [0.0, 0.0, 0.0, 1.0, 1.0, 1.0], "r2")
    verdict = identify(wrong, Options(method="instruments")).verdict
    assert verdict is not None
    assert (verdict.cause, verdict.robot) == ("sensor dead", "r2")
    assert verdict.words.startswith("angular velocities of r2")


@pytest.mark.parametrize(("channel", "axis", "words"), [("twist", 1, "wy of r2"), ("acceleration", 2, "az of r2")])
def test_an_axis_of_the_motion_that_was_not_measured_is_named(
    channel: str, axis: int, words: str, of_twists: Recording
) -> None:
    wrong = of_twists.changed(channel, lambda samples: samples * (np.arange(samples.shape[1]) != axis), "r2")
    verdict = identify(wrong, Options(method="instruments")).verdict
    assert verdict is not None
    assert (verdict.cause, verdict.robot) == ("sensor dead", "r2")
    assert verdict.words == f"{words} are exactly the same all the time: were they measured?"


@pytest.mark.parametrize("method", OF_TWISTS)
@pytest.mark.parametrize("is_all", [False, True])
def test_twists_with_the_velocity_first_are_refused(method: Method, is_all: bool, of_twists: Recording) -> None:
    wrong, names = of_twists, of_twists.names if is_all else ("r2",)
    for name in names:
        wrong = wrong.changed("twist", lambda twist: twist[:, [3, 4, 5, 0, 1, 2]], name)
    with pytest.raises(RecordingError, match=f"'twist' of {', '.join(names)}: .* Give the angular velocity first"):
        identify(wrong, Options(method=method))


def test_what_does_not_turn_shows_no_order_of_twists() -> None:
    """Velocities of hands are the same then, and angular velocities nothing but noise."""
    rng = np.random.default_rng(0)
    poses = grasps(rng)
    recording = sensors_recording(rng, exact_signals(rng, poses, motion=sliding()), SensorNoise())
    assert identify(recording, Options()).not_judged.startswith("motion and gravity do not show")


def test_what_is_not_observable_is_not_called_impossible() -> None:
    rng = np.random.default_rng(8)
    motion = body_motion(rng, np.arange(3000) / RATE, single_axis=True)
    recording = sensors_recording(rng, exact_signals(rng, grasps(rng), motion=motion), SensorNoise())
    found = identify(recording, Options(method="instruments"))
    assert not found.team.is_observable
    assert found.doubts == ()


@pytest.mark.parametrize("method", OF_TWISTS)
def test_accelerations_of_all_have_to_be_those_of_gravity(method: Method, of_twists: Recording) -> None:
    """Nothing else shows their common scale, and masses are wrong by it."""
    options = Options(method=method)
    found = identify(of_twists.changed("acceleration", lambda a: 1.03 * a), options)
    assert found.verdict is not None
    assert (found.verdict.cause, found.verdict.robot) == ("motion sensor", None)
    assert found.verdict.value == pytest.approx((1.03,), abs=2e-3)
    assert "1.03 times what they should be" in found.doubts[0]
    little = of_twists.changed("acceleration", lambda a: 1.005 * a)
    accepted = identify(little, options)
    assert accepted.doubts == ()
    assert deviations(little, accepted) < 5.0


def test_accelerations_in_other_axes_than_poses_are_named(team: Team, of_twists: Recording) -> None:
    poses = recorded(team, "white", by_twists=False)
    robots = {
        name: replace(robot, twist=None, pose=poses.robots[name].pose) for name, robot in of_twists.robots.items()
    }
    wrong = replace(of_twists, robots=robots).changed("acceleration", lambda a: a * [-1.0, -1.0, 1.0], "r2")
    verdict = identify(wrong, Options()).verdict
    assert verdict is not None
    assert (verdict.cause, verdict.robot) == ("motion sensor", "r2")
    assert "turned against its poses" in verdict.words


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
    assert "Record at least 6 s" in found.not_judged


@pytest.mark.parametrize("seed", [2006, 3046])
def test_noise_that_is_not_what_the_recording_says_is_not_believed(seed: int) -> None:
    """Vibration is no white noise: likelihood would be more than eight of its standard deviations off."""
    recording = recorded(draw_team(seed), "vibrating", by_twists=True)
    assert identify(recording, Options(method="likelihood")).doubts != ()
    found = identify(recording, Options())
    assert found.method == "instruments"
    assert found.doubts == ()
    assert deviations(recording, found) < 5.0


@pytest.mark.parametrize(
    ("sensor", "factor"),
    [*((sensor, 2.5) for sensor in SensorNoise.__struct_fields__), ("gyro", 0.4)],
)
def test_noise_that_samples_do_not_show_is_not_believed(sensor: str, factor: float, of_twists: Recording) -> None:
    """Likelihood would be up to twelve of its standard deviations off."""
    assert of_twists.noise is not None
    named = msgspec.structs.replace(of_twists.noise, **{sensor: factor * getattr(of_twists.noise, sensor)})
    recording = replace(of_twists, noise=named)
    words = f"Samples of {sensor} show {1.0 / factor:.2g} times the noise that 'noise' of the recording names"
    assert words in identify(recording, Options(method="likelihood")).doubts[0]
    found = identify(recording, Options())
    assert found.method == "instruments"
    assert found.doubts == ()
    assert f"{words}, so that --method likelihood does not suit it." in found.remarks
    assert deviations(recording, found) < 5.0


def test_robots_may_shake_against_each_other() -> None:
    rng = np.random.default_rng(0)
    recording = sensors_recording(rng, exact_signals(rng, grasps(rng)), SensorNoise())  # random pushes at each sample
    found = fitted(recording, "likelihood")
    assert (found.method, found.suspicions) == ("likelihood", ())


def test_forces_in_another_unit_than_moments_are_not_weighed_unasked() -> None:
    """All forces in kilograms look like all moments in another unit: what the load weighs depends on it."""
    recording = held_recording(4)
    for name in recording.names:
        in_kilograms = wrench_of(recording, name) * np.repeat([1.0 / 9.80665, 1.0], 3)
        recording = with_wrench(recording, name, in_kilograms)
    verdict = identify(recording, Options()).verdict
    assert verdict is not None
    assert (verdict.cause, verdict.robot, verdict.mass) == ("moment scale", None, None)
    assert "or forces 0.10" in verdict.words
    for cause in ("moment scale", "force scale"):
        found = identify(recording, Options(assume=cause))
        assert found.doubts == ()
        assert (deviations(recording, found) < 5.0) == (cause == "force scale")


def test_what_filters_do_at_the_ends_is_no_change_of_the_load() -> None:
    recording = recorded(draw_team(3445), "filtered", by_twists=False)
    assert identify(recording, Options()).doubts == ()


@pytest.mark.parametrize("seed", [3334, 3336])
def test_noise_of_the_motion_is_no_scale(seed: int) -> None:
    """Two robots that share a heavy load always alike: what one reads too much, the load may weigh too much."""
    recording = recorded(draw_team(seed), "white", by_twists=True)
    found = identify(recording, Options())
    assert found.doubts == ()
    assert deviations(recording, found) < 5.0


def test_a_unit_of_all_forces_is_not_seen_but_what_is_denser_than_any_material_is(of_twists: Recording) -> None:
    def times(factor: float) -> Recording:
        recording = of_twists
        for name in recording.names:
            recording = with_wrench(recording, name, factor * wrench_of(recording, name))
        return recording

    in_kilograms = identify(times(1.0 / 9.80665), Options(method="instruments"))
    assert in_kilograms.doubts == ()
    (remark,) = (remark for remark in in_kilograms.remarks if "a common factor of all forces and moments" in remark)
    truth = of_twists.truth
    assert truth is not None
    assert f"if they are in kgf, the mass is {truth.loads[0][1].mass:.2g}" in remark
    in_millinewtons = identify(times(1e3), Options(method="instruments"))
    assert any("denser than any material" in doubt for doubt in in_millinewtons.doubts)


@pytest.mark.parametrize(
    ("seed", "without"),
    [
        pytest.param(5, "r1", id="no gimbal has these orientations"),
        pytest.param(9, "", id="an angle passes half a turn"),
        pytest.param(20, "r3 r4", id="many errors are hardly seen, and so few samples of all are within bounds"),
        pytest.param(22, "r3", id="shorter lever arms would make noise of moments smaller"),
    ],
)
def test_good_recordings_are_accepted_when_calibration_errors_are_estimated_along(seed: int, without: str) -> None:
    recording = recorded(draw_team(seed), KINDS[seed // 2 % len(KINDS)], by_twists=False)
    found = identify(recording, Options(calibrate=True))
    assert found.doubts == ()
    assert deviations(recording, found) < 5.0
    robots = {finding.robot for finding in found.calibration if "angle" not in finding.what}
    assert robots == set(recording.names)
    told = {finding.robot for finding in found.calibration if "angle" in finding.what}
    assert robots - told == set(without.split())
    assert any(remark.startswith("No gimbal that is zero at home has") for remark in found.remarks) == bool(without)


def test_which_of_two_robots_to_correct_is_not_guessed() -> None:
    case = faulty("scale", 9027, by_twists=False)
    with pytest.raises(RecordingError, match="nothing says whose readings to correct"):
        identify(case.recording, Options(assume="scale"))


def test_whose_moments_are_in_another_unit_is_named() -> None:
    """Where other robots' moments are small, all may be thought of as too large: but then sensors are not alike."""
    recording = held_recording(4)
    for name in recording.names:
        small = wrench_of(recording, name) * np.repeat([1.0, 1e3 if name == "r2" else 1.0], 3)
        recording = with_wrench(recording, name, small)
    verdict = identify(recording, Options()).verdict
    assert verdict is not None
    assert (verdict.cause, verdict.robot) == ("moment scale", "r2")


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "mN and N·mm"), (1e-3, "kN and kN·m")])
def test_whose_wrenches_are_in_another_unit_is_named(factor: float, unit: str) -> None:
    recording = held_recording(4)
    recording = with_wrench(recording, "r2", factor * wrench_of(recording, "r2"))
    verdict = identify(recording, Options()).verdict
    assert verdict is not None
    assert (verdict.cause, verdict.robot) == ("scale", "r2")
    assert unit in verdict.words


def test_accelerations_with_the_opposite_sign_are_named(of_twists: Recording) -> None:
    verdict = identify(of_twists.changed("acceleration", np.negative, "r2"), Options(method="instruments")).verdict
    assert verdict is not None
    assert (verdict.cause, verdict.robot) == ("motion sensor", "r2")
    assert "accelerations have the opposite sign" in verdict.words


def test_vibrations_are_not_taken_for_white_noise() -> None:
    recording = recorded(draw_team(955006), "vibrating", by_twists=True)
    found = identify(recording)
    assert found.doubts == ()
    assert deviations(recording, found) < 5.0
    assert any("--method likelihood does not suit it" in remark for remark in found.remarks)


IN_OTHER_TESTS = (
    *("offset", "tared", "drift", "lever", "lever of all", "scale", "moment unit", "moment unit of all"),
    *("base axes", "base axes of all", "turned", "exchanged", "wrench clock", "wrench clock of all", "clock"),
    *("compensated", "tilted", "inverse of all", "length scale"),
)
"""Faults that other tests of recordings by poses name, and that take long."""


@pytest.mark.slow
@pytest.mark.parametrize("kind", [kind for kind in LISTED if kind not in IN_OTHER_TESTS])
def test_every_listed_fault_is_refuted_or_harmless(kind: str) -> None:
    trial = try_recording("listed", 1001 + 2 * ((LISTED.index(kind) + 4) % len(LISTED)))
    assert trial.kind == kind
    assert trial.is_refuted or (trial.off is not None and trial.off < 5.0), trial
    if trial.is_right is not None and trial.margin > 10.0:
        assert trial.is_right[0], trial


def test_faults_do_what_they_say() -> None:
    case = faulty("dead", 5, by_twists=False)
    assert case.robot is not None
    assert np.abs(wrench_of(case.recording, case.robot)).max() < 0.1


def test_hands_that_turn_exactly_alike_are_no_error(of_twists: Recording) -> None:
    """As in a recording without noise."""
    same = of_twists.robots[of_twists.names[0]].twist
    assert same is not None
    exact = of_twists
    for name in of_twists.names:
        exact = exact.changed("twist", lambda twist: np.hstack([same[:, :3], twist[:, 3:]]), name)
    check_twists(exact)
