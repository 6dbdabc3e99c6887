"""From samples to smooth motions, against motions known exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from coheft.errors import RecordingError
from coheft.estimation.batch.recording import Recording, RobotRecord, check_recording
from coheft.estimation.batch.signals import EDGE, body_rates, low_pass, rates, signals_of
from coheft.estimation.geometry.body_motion import BODY_A, BODY_ALPHA, BODY_V, BODY_W
from coheft.estimation.geometry.spatial import Array
from tests.estimation.batch_team import RATE, grasps, moving_recording

TIME = np.arange(3000) / RATE


def test_low_pass_lets_slow_things_through_unchanged_and_in_time() -> None:
    slow = np.sin(2.0 * np.pi * 0.5 * TIME)
    np.testing.assert_allclose(low_pass(slow, RATE, 5.0)[300:-300], slow[300:-300], atol=1e-5)
    fast = np.sin(2.0 * np.pi * 20.0 * TIME)
    assert np.abs(low_pass(fast, RATE, 5.0)[300:-300]).max() < 1e-3


@pytest.mark.parametrize("rate", [1.0, 3.0])
def test_derivatives_do_not_take_fast_motion_for_slower(rate: float) -> None:
    """Plain central differences are short by ``(w dt)^2 / 6``: by 6e-3 at 3 Hz."""
    angle = 2.0 * np.pi * rate * TIME[None, :, None]
    slope = 2.0 * np.pi * rate * np.cos(angle)[:, 2:-2]
    np.testing.assert_allclose(rates(np.sin(angle), RATE), slope, atol=1e-4 * np.abs(slope).max())
    # About an axis that turns with the body, so that before and after matter.
    turned = Rotation.from_euler("XY", np.column_stack([0.5 * np.sin(angle[0]), 0.8 * np.cos(angle[0])]))
    rotations = turned.as_matrix()
    before, after = (
        Rotation.from_euler("XY", np.column_stack([0.5 * np.sin(moved), 0.8 * np.cos(moved)]))
        for moved in (angle[0] - 1e-6, angle[0] + 1e-6)
    )
    exact = 2.0 * np.pi * rate * (before.inv() * after).as_rotvec()[2:-2] / 2e-6
    np.testing.assert_allclose(body_rates(rotations[None], RATE)[0], exact, atol=5e-4 * np.abs(exact).max())


def swinging(rate: float = 0.7) -> tuple[Recording, Array, Array]:
    """Two robots at the ends of a body that turns about x and moves along y; its angle and velocity of the angle."""
    angle, omega = 0.3 * np.sin(2.0 * np.pi * rate * TIME), 0.3 * 2.0 * np.pi * rate * np.cos(2.0 * np.pi * rate * TIME)
    quaternions = Rotation.from_rotvec(angle[:, None] * [1.0, 0.0, 0.0]).as_quat()
    position = np.outer(0.1 * np.sin(2.0 * np.pi * rate * TIME + 1.0), [0.0, 1.0, 0.0])
    robot = RobotRecord(TIME, pose=np.hstack([position, quaternions]), wrench=np.zeros((len(TIME), 6)))
    return Recording({"r1": robot, "r2": robot}), angle, omega


def test_motion_follows_from_poses() -> None:
    recording, angle, omega = swinging()
    found = signals_of(recording)
    kept = np.searchsorted(TIME, found.time - 1e-9)
    np.testing.assert_allclose(TIME[kept], found.time)
    assert found.time[0] >= EDGE
    assert found.time[-1] <= TIME[-1] - EDGE
    rate = 2.0 * np.pi * 0.7
    np.testing.assert_allclose(found.motion[0, :, 0], omega[kept], atol=1e-4)
    np.testing.assert_allclose(found.motion[0, :, 9], -(rate**2) * angle[kept], atol=2e-2)
    speed = 0.1 * rate * np.cos(rate * TIME[kept] + 1.0)
    acceleration = -0.1 * rate**2 * np.sin(rate * TIME[kept] + 1.0)
    cos, sin = np.cos(angle[kept]), np.sin(angle[kept])
    np.testing.assert_allclose(
        found.motion[0][:, BODY_V], np.stack([0 * speed, cos * speed, -sin * speed], axis=1), atol=2e-3
    )
    proper = np.stack([0 * cos, cos * acceleration + sin * 9.81, -sin * acceleration + cos * 9.81], axis=1)
    np.testing.assert_allclose(found.motion[0][:, BODY_A], proper, atol=1e-2)


def test_what_is_recorded_is_not_derived() -> None:
    recording, _, _ = swinging()
    constant = np.tile([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], (len(TIME), 1))
    robots = {name: replace(robot, twist=constant, dtwist=2.0 * constant) for name, robot in recording.robots.items()}
    found = signals_of(replace(recording, robots=robots))
    np.testing.assert_allclose(
        found.motion[..., BODY_W], np.tile([1.0, 2.0, 3.0], (*found.motion.shape[:2], 1)), atol=1e-9
    )
    np.testing.assert_allclose(
        found.motion[..., BODY_ALPHA], np.tile([2.0, 4.0, 6.0], (*found.motion.shape[:2], 1)), atol=1e-9
    )


def test_signs_of_quaternions_do_not_matter() -> None:
    recording = moving_recording(np.random.default_rng(0), grasps(np.random.default_rng(1)))
    signs = np.where(np.random.default_rng(2).uniform(size=len(recording.time)) < 0.5, -1.0, 1.0)
    flipped = {}
    for name, robot in recording.robots.items():
        assert robot.pose is not None
        flipped[name] = replace(robot, pose=np.hstack([robot.pose[:, :3], signs[:, None] * robot.pose[:, 3:]]))
    found, expected = signals_of(replace(recording, robots=flipped)), signals_of(recording)
    np.testing.assert_allclose(found.motion, expected.motion, atol=1e-9)


def test_all_robots_feel_one_rigid_body() -> None:
    rng = np.random.default_rng(4)
    team = grasps(rng)
    recording = moving_recording(rng, team)
    found = signals_of(recording, cutoff=20.0)
    for k, pose in enumerate(team):
        np.testing.assert_allclose(found.motion[k][:, BODY_W] @ pose.rotation.T, found.motion[0][:, BODY_W], atol=1e-4)
        carried = found.motion[k][:, BODY_V] @ pose.rotation.T + np.cross(pose.translation, found.motion[0][:, BODY_W])
        np.testing.assert_allclose(carried, found.motion[0][:, BODY_V], atol=1e-4)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"pose": None}, r"neither 'pose' of all robots \(not of r2\) nor 'twist' of all robots \(not of r1, r2\)"),
        ({"pose": None, "twist": np.zeros((3000, 6))}, r"'pose' of all robots \(not of r2\) .* tells where down is"),
    ],
)
def test_what_cannot_be_derived_is_refused(changes: dict[str, Array | None], message: str) -> None:
    recording, _, _ = swinging()
    twist = {"twist": changes["twist"]} if "twist" in changes else {}
    robots = {
        name: replace(robot, **(changes if name == "r2" else twist))  # type: ignore[arg-type]
        for name, robot in recording.robots.items()
    }
    with pytest.raises(RecordingError, match=message):
        signals_of(replace(recording, robots=robots))


def test_short_recordings_are_refused() -> None:
    recording, _, _ = swinging()
    with pytest.raises(RecordingError, match="dropped at both ends"):
        signals_of(recording.between(0.0, 4.0))
    with pytest.raises(RecordingError, match="the filter takes more than 60: record for longer"):
        signals_of(recording.between(0.0, 0.3))


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (
            lambda r: replace(r, time=r.time[::-1]),
            "'t' of r2: sample 2 is of .* s, the one before of .* expected times that grow",
        ),
        (lambda r: replace(r, time=r.time**2 + r.time), "times of robots differ, or have unequal steps"),
        (lambda r: replace(r, time=r.time + 1.0), "times of robots differ, or have unequal steps"),
        (lambda r: replace(r, pose=r.pose[:-1]), r"'pose' of r2: found shape \(2999, 7\), expected \(3000, 7\)"),
        (
            lambda r: replace(r, pose=2.0 * r.pose),
            "'pose' of r2: expected unit quaternions .* norm, the first at 0 s, 2",
        ),
        (lambda r: replace(r, wrench=np.where(np.arange(6) == 2, np.nan, r.wrench)), "'wrench' of r2: not a finite"),
    ],
)
def test_unusable_recordings_are_refused_with_the_reason(spoil, message: str) -> None:  # type: ignore[no-untyped-def]
    recording, _, _ = swinging()
    robots = {"r1": recording.robots["r1"], "r2": spoil(recording.robots["r2"])}
    with pytest.raises(RecordingError, match=message):
        check_recording(replace(recording, robots=robots))


@pytest.mark.parametrize(("end", "found"), [(1.004, 1), (0.999, 0)])
def test_parts_hold_two_samples_at_least(end: float, found: int) -> None:
    recording, _, _ = swinging()
    with pytest.raises(RecordingError, match=f"found {found} samples from 0.995 s to .* expected at least 2: they are"):
        recording.between(0.995, end)


def test_one_robot_is_no_team() -> None:
    recording, _, _ = swinging()
    with pytest.raises(RecordingError, match="found 1 robot, expected at least 2"):
        check_recording(replace(recording, robots={"r1": recording.robots["r1"]}))
