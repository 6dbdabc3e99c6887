"""Grasps and calibration errors from poses alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from coheft.estimation.batch.hand_eye import fit_hand_eye
from coheft.estimation.batch.hand_eye_equations import UNKNOWNS, Guess, normal_equations, residuals_and_derivatives
from coheft.estimation.batch.wrist_poses import (
    POSE_ERRORS,
    Tolerances,
    WristPoses,
    corrected_poses,
    gimbal_angles,
    gimbal_axes,
    gimbal_rotations,
)
from coheft.estimation.geometry.body_motion import perturbation_between, perturbed
from coheft.estimation.geometry.spatial import Array, Pose, rotation_exp
from tests.estimation.batch_team import RATE, grasps, moving_recording
from tests.estimation.team import random_pose

seeds = st.integers(0, 2**32 - 1)
TOLERANCES = Tolerances(zero=0.006, angle_scale=0.006, position_scale=0.017, force_scale=0.006, force_offset=0.3)


def wrists(
    rng: np.random.Generator,
    team: tuple[Pose, ...],
    seconds: float,
    angle: float = 6e-4,
    position: float = 5e-4,
    at_home: bool = False,
) -> WristPoses:
    """Measured with white noise of these standard deviations."""
    recording = moving_recording(rng, team, seconds)
    exact = WristPoses.of(recording.stacked("pose"), recording.rate, at_home=at_home)
    return replace(
        exact,
        angles=exact.angles + angle * rng.normal(size=exact.angles.shape),
        positions=exact.positions + position * rng.normal(size=exact.positions.shape),
    )


def level_grasps(rng: np.random.Generator) -> tuple[Pose, ...]:
    """Turned about the vertical only, as gimbals are that carry a load between them."""
    others = (Pose(rotation_exp(np.array([0.0, 0.0, rng.uniform(-3.0, 3.0)])), rng.normal(size=3)) for _ in range(2))
    return (Pose.identity(), *others)


@given(seeds)
def test_gimbal_angles_are_those_of_the_rotation(seed: int) -> None:
    angles = np.random.default_rng(seed).uniform(-1.4, 1.4, (10, 3))
    np.testing.assert_allclose(gimbal_angles(gimbal_rotations(angles)), angles, atol=1e-12)
    x, y, z = (rotation_exp(angle * axis) for angle, axis in zip(angles[0], np.eye(3), strict=True))
    np.testing.assert_allclose(gimbal_rotations(angles)[0], x @ y @ z, atol=1e-12)


@given(seeds)
def test_gimbal_axes_are_derivatives(seed: int) -> None:
    angles = np.random.default_rng(seed).uniform(-1.4, 1.4, 3)
    for axis in range(3):
        step = 1e-6 * np.eye(3)[axis]
        turn = gimbal_rotations(angles + step) @ gimbal_rotations(angles - step).T
        np.testing.assert_allclose(
            Rotation.from_matrix(turn).as_rotvec() / 2e-6, gimbal_axes(angles[None])[0, :, axis], atol=1e-8
        )


def test_correction_undoes_what_calibration_errors_do() -> None:
    rng = np.random.default_rng(0)
    angles, positions, errors = rng.uniform(-1.0, 1.0, (8, 3)), rng.normal(size=(8, 3)), 0.02 * rng.normal(size=7)
    told = (1.0 + errors[3:6]) * angles + errors[:3]
    rotations, places = corrected_poses(told, (1.0 + errors[6]) * positions, errors)
    np.testing.assert_allclose(rotations, gimbal_rotations(angles), atol=1e-12)
    np.testing.assert_allclose(places, positions, atol=1e-12)


@given(seeds)
def test_derivatives_are_those_of_finite_differences(seed: int) -> None:
    rng = np.random.default_rng(seed)
    home, grasp, errors = random_pose(rng, 0.3), random_pose(rng, 0.3), 0.02 * rng.normal(size=POSE_ERRORS)
    rotations = Rotation.from_rotvec(0.3 * rng.normal(size=(4, 3))).as_matrix()
    positions = rng.normal(size=(4, 3))
    zeros = rotation_exp(rng.normal(size=3))[None]
    # Derivatives do not depend on what was measured.
    told = WristPoses(rng.normal(size=(1, 4, 3)), rng.normal(size=(1, 4, 3)), zeros, RATE, np.ones(1, np.bool_))

    def residual(unknowns: Array, load: Array) -> Array:
        turned = rotation_exp(load[:3]) @ rotations
        homes, held = (perturbed(home, unknowns[:6]),), (perturbed(grasp, unknowns[6:12]),)
        moved = Guess(homes, held, errors[None] + unknowns[12:], turned, positions + load[3:])
        return residuals_and_derivatives(told, moved, 0)[0]

    guess = Guess((home,), (grasp,), errors[None], rotations, positions)
    _, derivative, by_load = residuals_and_derivatives(told, guess, 0)
    step = 1e-6
    nothing, still = np.zeros(UNKNOWNS), np.zeros(6)
    for k, axis in enumerate(step * np.eye(UNKNOWNS)):
        slope = (residual(axis, still) - residual(-axis, still)) / (2.0 * step)
        np.testing.assert_allclose(derivative[:, :, k], slope, atol=1e-7)
    for k, axis in enumerate(step * np.eye(6)):
        slope = (residual(nothing, axis) - residual(nothing, -axis)) / (2.0 * step)
        np.testing.assert_allclose(by_load[:, :, k], slope, atol=1e-7)


@pytest.mark.parametrize("count", [2, 3, 4])
def test_fit_is_exact_without_noise_from_a_rough_start(count: int) -> None:
    rng = np.random.default_rng(count)
    team = grasps(rng, count)
    measured = wrists(rng, team, 10.0, 1e-9, 1e-9)
    start = [perturbed(pose, 0.02 * rng.normal(size=6)) if k else pose for k, pose in enumerate(team)]
    found = fit_hand_eye(measured, start)
    assert found.team.is_settled
    for pose, true in zip(found.team.poses, team, strict=True):
        np.testing.assert_allclose(perturbation_between(pose, true), 0.0, atol=1e-7)


@pytest.mark.slow
def test_noise_is_found_and_covariance_honest() -> None:
    rng = np.random.default_rng(5)
    team = grasps(rng)
    squares = []
    for _ in range(15):
        found = fit_hand_eye(wrists(rng, team, 20.0), team)
        assert found.noise == pytest.approx((6e-4, 5e-4), rel=0.05)
        for k in (1, 2):
            own = slice(6 * k, 6 * k + 6)
            error = perturbation_between(found.team.poses[k], team[k])
            squares.append(float(error @ np.linalg.solve(found.team.covariance[own, own], error)) / 6.0)
    # 180 squares, covariances from 20 stretches each: mean 1 up to 0.11, and a little more.
    assert 0.65 < np.mean(squares) < 1.7


def test_poses_of_different_loads_do_not_settle() -> None:
    rng = np.random.default_rng(8)
    team = grasps(rng)
    several = [wrists(rng, team, 10.0) for _ in team]
    mixed = {
        name: np.array([getattr(own, name)[k] for k, own in enumerate(several)])
        for name in ("angles", "positions", "zeros")
    }
    assert not fit_hand_eye(replace(several[0], **mixed), team).team.is_settled


def test_every_sample_says_as_much_about_the_noise() -> None:
    """However many samples are worked on at a time: 4000, and one that is left over."""
    rng = np.random.default_rng(7)
    measured = wrists(rng, grasps(rng), 40.01)
    guess = Guess(
        tuple(random_pose(rng, 0.01, 0.01) for _ in range(3)),
        grasps(rng),
        np.zeros((3, POSE_ERRORS)),
        measured.rotations(0),
        measured.positions[0],
    )
    whole = normal_equations(measured, guess, (1e-3, 1e-3))
    first, last = (
        normal_equations(
            measured.some(rows),
            replace(guess, rotations=guess.rotations[rows], positions=guess.positions[rows]),
            (1e-3, 1e-3),
        )
        for rows in (slice(0, 4000), slice(4000, None))
    )
    shares = np.array([4000.0, 1.0]) / 4001.0
    expected = np.sqrt(shares @ np.square([first.noise, last.noise]))
    np.testing.assert_allclose(whole.noise, expected, rtol=1e-6)
    assert abs(last.noise[1] / first.noise[1] - 1.0) > 0.01


def test_calibration_errors_are_found_where_they_can_be() -> None:
    rng = np.random.default_rng(6)
    team = level_grasps(rng)
    measured = wrists(rng, team, 60.0, at_home=True)
    spread = TOLERANCES.pose_errors()
    true = spread * rng.normal(size=(3, POSE_ERRORS))
    wrong = replace(
        measured,
        angles=(1.0 + true[:, None, 3:6]) * measured.angles + true[:, None, :3],
        positions=(1.0 + true[:, None, 6:]) * measured.positions,
    )
    found = fit_hand_eye(wrong, team, TOLERANCES)
    deviations = (found.errors - true) / found.errors_std
    assert np.abs(deviations).max() < 4.5
    # The last angle's zero turns the grasp frame itself, and a ruler common to all changes nothing.
    np.testing.assert_allclose(found.errors_std[:, 2], spread[2], rtol=0.02)
    np.testing.assert_allclose(found.errors_std[:, 6], spread[6] / np.sqrt(3.0), rtol=0.05)
    for seen in ([0, 1], [3, 4, 5]):
        assert (found.errors_std[:, seen] < 0.2 * spread[seen]).all()
    ratios = found.errors[:, 6] - found.errors[:, 6].mean() - (true[:, 6] - true[:, 6].mean())
    assert np.abs(ratios).max() < 0.05 * spread[6]
    without = fit_hand_eye(wrong, team)
    honest = [np.linalg.norm(perturbation_between(found.team.poses[k], team[k])[:3]) for k in (1, 2)]
    assert without.noise[1] > 1.2 * found.noise[1]
    assert max(honest) < 4.0 * np.sqrt(2.0) * spread[2]


def test_angles_do_not_jump_at_half_a_turn() -> None:
    """Means of samples on both sides would be zero, and a scale error would jump."""
    true = np.column_stack([np.pi + 0.2 * np.sin(np.arange(100.0)), np.zeros((100, 2))])
    poses = np.zeros((2, 100, 7))
    poses[..., 3:] = Rotation.from_euler("XYZ", true).as_quat()
    measured = WristPoses.of(poses, RATE, at_home=True)
    assert np.ptp(measured.angles[0, :, 0]) < 0.41
    assert abs(np.cos(measured.averaged(RATE / 4.0).angles[0, :, 0]).max() + 1.0) < 0.02
    np.testing.assert_allclose(measured.rotations(1), gimbal_rotations(true), atol=1e-12)
    told = replace(measured, angles=1.01 * measured.angles)
    at = Pose(np.eye(3), np.zeros(3))
    errors = 0.01 * np.eye(POSE_ERRORS)[3]
    guess = Guess((at,), (at,), errors[None], measured.rotations(0), np.zeros((100, 3)))
    residual, derivative, _ = residuals_and_derivatives(told, guess, 0)
    assert np.abs(residual).max() < 1e-12
    np.testing.assert_allclose(derivative[:, 0, 15], -measured.angles[0, :, 0], atol=1e-12)


@pytest.mark.parametrize(("speed", "rate"), [(0.2, 25.0), (2.5, 100.0)])
def test_means_over_arcs_do_not_shorten_levers(speed: float, rate: float) -> None:
    turns = Rotation.from_euler("z", speed * np.arange(200)[:, None] / RATE)
    poses = np.hstack([turns.apply([0.5, 0.0, 0.0]), turns.as_quat()])
    found = WristPoses.of(np.array([poses, poses]), RATE, at_home=False).averaged(25.0)
    assert found.rate == rate
    np.testing.assert_allclose(np.linalg.norm(found.positions, axis=-1), 0.5, atol=1e-5)
    in_hand = np.einsum("ni,nij->nj", found.positions[0], found.rotations(0))
    np.testing.assert_allclose(in_hand, np.tile([0.5, 0.0, 0.0], (len(in_hand), 1)), atol=1e-5)


def test_of_very_many_means_some_are_kept() -> None:
    turns = Rotation.from_euler("z", 0.025 * np.arange(120_000)[:, None])
    poses = np.hstack([turns.apply([0.5, 0.0, 0.0]), turns.as_quat()])
    found = WristPoses.of(np.array([poses, poses]), RATE, at_home=False).averaged(25.0)
    assert (found.rate, found.positions.shape) == (RATE / 3.0, (2, 40_000, 3))
    np.testing.assert_allclose(found.positions[0], poses[::3, :3], atol=1e-12)


def test_robots_with_orientations_of_no_gimbal_have_no_errors_of_angles() -> None:
    poses = np.zeros((2, 5, 7))
    poses[..., 3:] = Rotation.from_euler("XYZ", [[0.1, 1.5, 0.2], [0.1, 1.2, 0.2]]).as_quat()[:, None]
    found = WristPoses.of(poses, RATE, at_home=True)
    assert found.has_gimbal.tolist() == [False, True]
    assert np.abs(found.angles[0]).max() < 1e-12
    np.testing.assert_allclose(found.angles[1], np.tile([0.1, 1.2, 0.2], (5, 1)), atol=1e-12)
    assert not WristPoses.of(poses, RATE, at_home=False).has_gimbal.any()
    rng = np.random.default_rng(6)
    team = level_grasps(rng)
    measured = replace(wrists(rng, team, 60.0, at_home=True), has_gimbal=np.array([True, False, True]))
    errors_std = fit_hand_eye(measured, team, TOLERANCES).errors_std
    assert (errors_std[1, :6] == 0.0).all()
    assert (errors_std[[0, 2], :6] > 0.0).all()
    assert (errors_std[:, 6] > 0.0).all()
