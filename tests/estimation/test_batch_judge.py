"""A judge of recordings: good ones are accepted, wrong ones refuted, with their cause, and what would mend them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from coheft.app.identify.choices import Options
from coheft.app.identify.methods import identify
from coheft.estimation.batch.identification import Identification
from coheft.estimation.batch.judge.verdict import Verdict
from coheft.estimation.batch.plausibility import inverse_poses
from coheft.estimation.batch.recording import Recording
from coheft.estimation.batch.signals import CUTOFF, low_pass
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.rigid_body.mass_properties import Inertia, combined
from tests.estimation.batch_team import HELD, held_recording
from tests.estimation.recorded_faults import (
    Fault,
    drifting,
    exchanged,
    half_in_home_axes,
    home_turned,
    in_home_axes,
    late,
    lever,
    one_axis,
    to_wrench,
    turned,
    weight,
    with_fault,
)

SEED = 4


def judged(recording: Recording) -> tuple[Identification, Verdict]:
    found = identify(recording, Options())
    assert found.verdict is not None
    return found, found.verdict


def deviations(recording: Recording, found: Identification) -> Array:
    """Errors in standard deviations, what may be hidden counted in."""
    assert recording.truth is not None
    truth = recording.truth.loads[0][1].central()
    hidden = np.array([error.std for error in found.hidden])
    result: Array = np.abs(found.payload.inertia.central() - truth) / np.hypot(found.payload.std, hidden)
    return result


@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize("seed", range(3))
def test_good_recordings_are_accepted(seed: int, count: int) -> None:
    recording = held_recording(seed, count)
    found, verdict = judged(recording)
    assert not verdict.is_refuted, verdict.words
    assert found.doubts == ()
    assert len(found.hidden) == 10
    assert deviations(recording, found).max() < 5.0


@pytest.mark.parametrize(
    ("fault", "robots", "cause", "robot"),
    [
        (to_wrench(lambda wrench: wrench + [4.0, -3.0, 2.0, 0.0, 0.0, 0.0]), (), "offset", "r2"),
        (to_wrench(lambda wrench: wrench - wrench[:20].mean(axis=0)), ("r1", "r2", "r3"), "offset", None),
        (to_wrench(lever), (), "lever", "r2"),
        (to_wrench(lever), ("r1", "r2", "r3"), "lever", None),
        (to_wrench(lambda wrench: 1.1 * wrench), (), "scale", "r2"),
        (to_wrench(lambda wrench: -wrench), (), "scale", "r2"),
        (in_home_axes, (), "base axes", "r2"),
        (in_home_axes, ("r1", "r2", "r3"), "base axes", None),
        (half_in_home_axes(0), (), "base axes", "r2"),
        (half_in_home_axes(1), ("r1", "r2", "r3"), "base axes", None),
        (one_axis(2, -1.0), (), "axis scale", "r2"),
        (one_axis(4, -1.0), (), "axis scale", "r2"),
        (one_axis(2, 1.05), (), "axis scale", "r2"),
        (to_wrench(turned), (), "sensor turned", "r2"),
        (to_wrench(turned), ("r1", "r2", "r3"), "sensor turned", None),
        (to_wrench(exchanged), ("r1", "r2", "r3"), "sensor turned", None),
        (to_wrench(lambda wrench: wrench[:, [3, 4, 5, 0, 1, 2]]), (), "forces for moments", "r2"),
        (to_wrench(lambda wrench: wrench * [1, 1, 1, 3.281, 3.281, 3.281]), ("r1", "r2", "r3"), "moment scale", None),
        (weight(-2.0), (), "weight compensated", None),
        (weight(1.2), (), "weight compensated", None),
        (to_wrench(drifting), (), "drift", "r2"),
        (to_wrench(late), (), "clock", "r2"),
        (to_wrench(late), ("r1", "r2", "r3"), "clock", None),
        (home_turned(np.array([0.05, 0.0, 0.0])), (), "homes not level", "r2"),
        (home_turned(np.array([np.pi / 2.0, 0.0, 0.0])), (), "homes not level", "r2"),
    ],
)
def test_one_fault_is_named_and_mended(fault: Fault, robots: tuple[str, ...], cause: str, robot: str | None) -> None:
    found, verdict = judged(with_fault(held_recording(SEED), fault, *robots))
    assert verdict.is_refuted
    assert (verdict.cause, verdict.robot) == (cause, robot), verdict.words
    assert found.doubts[0] == verdict.words
    if verdict.is_open:
        return
    assert verdict.mass is not None
    mass, std = verdict.mass
    assert abs(mass - HELD.mass) < 5.0 * std
    assert f"the mass is {mass:.4g} kg" in verdict.words


def test_a_fault_that_leaves_much_is_not_called_the_only_one() -> None:
    def behind(wrench: Array) -> Array:
        return np.hstack([wrench[:, :3], wrench[:, 3:] + np.cross([0.0, 0.0, 0.1], wrench[:, :3])])

    untared = with_fault(held_recording(SEED), to_wrench(lambda wrench: wrench + [4.0, -3.0, 2.0, 0.0, 0.0, 0.0]))
    _, verdict = judged(with_fault(untared, to_wrench(behind), "r3"))
    assert (verdict.cause, verdict.mass) == ("offset", None)
    assert "One fault explains most of this" in verdict.words
    assert "there may be another besides" in verdict.words


@pytest.mark.parametrize("with_wrench", [True, False])
@pytest.mark.parametrize("robot", ["r1", "r2"])
def test_a_clock_that_is_late_is_named(with_wrench: bool, robot: str) -> None:
    recording = with_fault(
        held_recording(SEED), lambda pose, wrench: (late(pose), late(wrench) if with_wrench else wrench), robot
    )
    _, verdict = judged(recording)
    assert (verdict.cause, verdict.robot) == ("clock", robot)
    assert verdict.value[0] == pytest.approx(0.03, abs=0.002)
    assert "ms late against the others'" in verdict.words


def test_of_two_robots_either_clock_may_be_wrong() -> None:
    _, verdict = judged(with_fault(held_recording(SEED, 2), lambda pose, wrench: (late(pose), late(wrench))))
    assert (verdict.cause, verdict.robot) == ("clock", None)
    assert "(or those of the other robot, the other way round)" in verdict.words


@pytest.mark.parametrize("seed", [0, 4])
def test_noise_of_a_slow_motion_is_no_late_clock(seed: int) -> None:
    _, verdict = judged(held_recording(seed, speed=0.03))
    assert not verdict.is_refuted, verdict.words


@pytest.mark.parametrize(("seed", "speed"), [(0, 3.0), (1, 4.0)])
def test_fast_motions_are_filtered_less(seed: int, speed: float) -> None:
    recording = held_recording(seed, speed=speed)
    found, verdict = judged(recording)
    assert not verdict.is_refuted, verdict.words
    assert deviations(recording, found).max() < 5.0
    assert "The motion is fast: filters have a cutoff of" in found.remarks[-1]
    by_user = identify(recording, Options(cutoff=CUTOFF))
    assert by_user.doubts != ()
    assert "The motion is fast" not in " ".join(by_user.remarks)


@pytest.mark.parametrize("columns", [slice(0, 6), slice(3, 6)])
def test_a_sensor_that_repeats_itself_is_named(columns: slice) -> None:
    def stuck(wrench: Array) -> Array:
        wrench[1000:1200, columns] = wrench[1000, columns]
        return wrench

    _, verdict = judged(with_fault(held_recording(SEED), to_wrench(stuck)))
    assert (verdict.cause, verdict.robot, verdict.value) == ("sensor dead", "r2", (10.0,))


@pytest.mark.parametrize(("columns", "words"), [([2], "fz of r2"), ([3, 4, 5], "mx, my, mz of r2")])
def test_axes_that_were_not_measured_are_named(columns: list[int], words: str) -> None:
    wrong = with_fault(held_recording(SEED), to_wrench(lambda wrench: wrench * ~np.isin(np.arange(6), columns)))
    _, verdict = judged(wrong)
    assert (verdict.cause, verdict.robot) == ("sensor dead", "r2")
    assert words in verdict.words


@pytest.mark.parametrize("axis", [0, 2])
def test_an_axis_that_has_nothing_but_noise_is_named(axis: int) -> None:
    recording = held_recording(SEED)
    noise = 0.2 * np.random.default_rng(0).normal(size=(len(recording.time), 6))
    silent = to_wrench(lambda wrench: np.where(np.arange(6) == axis, noise, wrench))
    _, verdict = judged(with_fault(recording, silent))
    assert (verdict.cause, verdict.robot) == ("sensor dead", "r2")
    assert f"f{'xyz'[axis]} of r2 is nothing but noise" in verdict.words


@pytest.mark.parametrize("factor", [1.25, 0.98])
def test_times_in_a_wrong_unit_are_named(factor: float) -> None:
    recording = held_recording(SEED)
    robots = {name: replace(robot, time=factor * robot.time) for name, robot in recording.robots.items()}
    _, verdict = judged(replace(recording, robots=robots))
    assert verdict.cause == "time scale"
    assert verdict.value == pytest.approx((factor,), rel=2e-3)
    assert verdict.mass is not None
    assert verdict.mass[0] == pytest.approx(HELD.mass, rel=1e-2)


def slipped(turn_deg: float, shift: float) -> Fault:
    """From 10 s on the grasp frame is elsewhere in the load."""

    def fault(pose: Array, wrench: Array) -> tuple[Array, Array]:
        own = Rotation.from_quat(pose[1000:, 3:])
        step, turn = np.array([0.0, shift, 0.0]), Rotation.from_rotvec([np.radians(turn_deg), 0.0, 0.0])
        pose[1000:, :3] += own.apply(step)
        pose[1000:, 3:] = (own * turn).as_quat()
        force, moment = wrench[1000:, :3].copy(), wrench[1000:, 3:].copy()
        wrench[1000:, :3] = turn.inv().apply(force)
        wrench[1000:, 3:] = turn.inv().apply(moment - np.cross(step, force))
        return pose, wrench

    return fault


@pytest.mark.parametrize(("turn_deg", "shift"), [(0.0, 0.005), (1.0, 0.0), (1.0, 0.02)])
def test_a_grasp_that_slips_is_named(turn_deg: float, shift: float) -> None:
    _, verdict = judged(with_fault(held_recording(SEED), slipped(turn_deg, shift)))
    assert (verdict.cause, verdict.robot) == ("slip", "r2")
    assert verdict.value == pytest.approx((turn_deg, shift, 10.0), abs=0.2)
    assert verdict.value[1] == pytest.approx(shift, abs=2e-4)


def test_of_two_robots_either_grasp_may_have_slipped() -> None:
    _, verdict = judged(with_fault(held_recording(SEED, 2), slipped(0.0, 0.005)))
    assert (verdict.cause, verdict.robot) == ("slip", None)


def test_a_grip_that_gives_neither_slips_nor_stretches() -> None:
    for seed in range(6):
        rng = np.random.default_rng(seed)

        def giving(pose: Array, wrench: Array, rng: np.random.Generator = rng) -> tuple[Array, Array]:
            bend = low_pass(3e-3 * rng.normal(size=(len(pose), 3)), 100.0, 0.5)
            pose[:, :3] += Rotation.from_quat(pose[:, 3:]).apply(bend)
            return pose, wrench

        _, verdict = judged(with_fault(held_recording(SEED), giving))
        assert verdict.cause not in ("slip", "length scale")


@pytest.mark.parametrize("factor", [0.1, 0.995, 1.03])
def test_lengths_of_one_robot_are_compared_with_the_others(factor: float) -> None:
    def stretched(pose: Array, wrench: Array) -> tuple[Array, Array]:
        return pose * np.repeat([factor, 1.0], [3, 4]), wrench

    wrong = with_fault(held_recording(SEED), stretched)
    _, verdict = judged(wrong)
    assert (verdict.cause, verdict.robot) == ("length scale", "r2")
    assert verdict.value == pytest.approx((factor,), rel=1e-3)
    assumed = identify(wrong, Options(assume="length scale"))
    assert assumed.doubts == ()
    assert deviations(wrong, assumed).max() < 5.0
    _, of_two = judged(with_fault(held_recording(SEED, 2), stretched))
    assert (of_two.cause, of_two.robot) == ("length scale", None)


def test_poses_that_repeat_themselves_are_named() -> None:
    def stuck(pose: Array, wrench: Array) -> tuple[Array, Array]:
        pose[1000:] = pose[1000]
        return pose, wrench

    _, verdict = judged(with_fault(held_recording(SEED), stuck))
    assert (verdict.cause, verdict.robot, verdict.value) == ("sensor dead", "r2", (10.0,))


def test_inverse_poses_of_all_are_named() -> None:
    recording = held_recording(SEED)
    found, verdict = judged(with_fault(recording, lambda pose, wrench: (inverse_poses(pose), wrench), *recording.names))
    assert verdict.cause == "inverse poses"
    assert found.doubts[0] == verdict.words


def test_a_sensor_that_has_nothing_but_noise_is_named() -> None:
    rng = np.random.default_rng(1)
    noise = to_wrench(lambda wrench: np.hstack([0.2 * rng.normal(size=(len(wrench), 3)), 0.0 * wrench[:, 3:]]))
    _, verdict = judged(with_fault(held_recording(SEED), noise))
    assert (verdict.cause, verdict.robot) == ("sensor dead", "r2")
    assert "nothing but noise" in verdict.words


def test_hands_in_gimbals_have_no_moments() -> None:
    """Robots that hold the load at one point each: their moments are zero all the time."""
    recording = held_recording(SEED)
    names = recording.names
    assert recording.truth is not None
    grasps = recording.truth.poses
    wrenches = recording.stacked("wrench")
    total = sum(own @ grasp.adjoint().T for own, grasp in zip(wrenches, grasps, strict=True))
    # Forces at three points that make up the total wrench, the least of all.
    to_first = np.hstack([grasp.adjoint()[:, :3] for grasp in grasps])
    forces = total @ np.linalg.pinv(to_first).T
    robots = {
        name: replace(
            recording.robots[name], wrench=np.hstack([forces[:, 3 * k : 3 * k + 3], 0.0 * wrenches[k][:, 3:]])
        )
        for k, name in enumerate(names)
    }
    _, verdict = judged(replace(recording, robots=robots))
    assert verdict.cause != "sensor dead"


def test_homes_on_their_sides_are_not_taken_for_exchanged_columns() -> None:
    on_its_side = home_turned(np.array([0.0, -np.pi / 2.0, 0.0]))
    _, verdict = judged(with_fault(held_recording(2), on_its_side, "r1", "r2", "r3"))
    assert verdict.cause == "homes not level"
    assert verdict.mass is not None
    assert verdict.mass[0] == pytest.approx(HELD.mass, abs=0.01)


def test_a_tilted_cell_is_named() -> None:
    """Home frames that are level with each other, but not with the floor."""
    recording = held_recording(SEED)
    for k, name in enumerate(recording.names):
        yaw = Rotation.from_euler("z", 0.7 * k)
        recording = with_fault(recording, home_turned((yaw.inv()).apply([0.1, 0.0, 0.0])), name)
    _, verdict = judged(recording)
    assert verdict.cause == "gravity"
    assert "tilted, by 5.7" in verdict.words
    assert verdict.mass is not None
    assert abs(verdict.mass[0] - HELD.mass) < 5.0 * verdict.mass[1]


def test_a_load_that_changes_is_named() -> None:
    more = combined([HELD, Inertia(1.0, np.array([0.1, 0.1, 0.0]), 0.01 * np.eye(3))])
    _, verdict = judged(held_recording(SEED, change=(12.0, more)))
    assert verdict.cause == "load change"
    assert verdict.value[-1] == pytest.approx(12.0, abs=0.2)


def test_two_robots_do_not_tell_whose_scale_is_wrong() -> None:
    _, verdict = judged(with_fault(held_recording(SEED, 2), to_wrench(lambda wrench: 1.1 * wrench)))
    assert verdict.cause == "scale"
    assert verdict.robot is None
    assert verdict.mass is None
    assert "which two robots cannot tell" in verdict.words


def test_readings_that_do_not_belong_to_the_load_have_no_scale() -> None:
    shifted = to_wrench(lambda wrench: wrench[:, [1, 2, 3, 4, 5, 0]])
    _, verdict = judged(with_fault(held_recording(5), shifted))
    assert verdict.cause == "unknown"
    assert "forces and moments of r2 have nothing to do with the load" in verdict.words


def test_several_faults_are_no_single_cause() -> None:
    recording = with_fault(held_recording(SEED), to_wrench(lambda wrench: lever(late(wrench)) + [5, 0, 0, 0, 0, 0]))
    recording = with_fault(recording, in_home_axes, "r3")
    found, verdict = judged(recording)
    assert verdict.is_refuted
    assert verdict.cause == "unknown"
    assert verdict.mass is None
    assert "no single cause explains it" in found.doubts[0]


@pytest.mark.parametrize("seed", range(3))
def test_what_is_too_small_to_be_seen_is_counted_in(seed: int) -> None:
    """A scale that is off by little is many deviations of the noise alone, but not of what may be hidden."""
    recording = with_fault(held_recording(seed), to_wrench(lambda wrench: 1.002 * wrench))
    found, verdict = judged(recording)
    assert not verdict.is_refuted
    assert deviations(recording, found).max() < 5.0
    assert found.hidden[0].std > 3.0 * found.payload.std[0]


def test_a_drift_that_hardly_matters_is_accepted() -> None:
    """More than noise, but less than a fiftieth of what changes in the forces."""
    time = np.arange(2500) / 100.0
    drift = 0.03 * np.sin(2.0 * np.pi * 0.05 * time[:, None] + np.random.default_rng(1).uniform(0.0, 6.0, 6))
    drifting = to_wrench(lambda wrench: wrench + drift * [1.0, 1.0, 1.0, 0.1, 0.1, 0.1])
    recording = held_recording(1)
    recording = with_fault(recording, drifting, *recording.names)
    found, verdict = judged(recording)
    assert not verdict.is_refuted, verdict.words
    assert deviations(recording, found).max() < 5.0
