"""Inertia from motion, and mass and centre of mass from rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

from coheft.errors import RecordingError
from coheft.estimation.batch.holds import Holds, find_holds, orientations, static_estimate
from coheft.estimation.batch.identify import identify_batch, parameters_fit
from coheft.estimation.batch.inertia_fit import bias_of_tensor, fit_parameters, fit_tensor
from coheft.estimation.batch.pairs import derivative_by_poses
from coheft.estimation.batch.payload import make_payload, of_central_numbers, principal_inertia
from coheft.estimation.batch.recording import RobotRecord
from coheft.estimation.batch.signals import body_motions, regressor, total_wrench
from coheft.estimation.geometry.body_motion import BODY_ALPHA
from coheft.estimation.geometry.spatial import Array, Pose, rotation_exp
from coheft.estimation.rigid_body.mass_properties import Inertia, pack_symmetric
from tests.estimation.batch_team import LOAD, RATE, exact_signals, grasps, moving_recording, with_noise
from tests.rigid_motions import rotations

seeds = st.integers(0, 2**32 - 1)


@given(seeds)
def test_regressor_times_parameters_is_the_wrench(seed: int) -> None:
    motion = np.random.default_rng(seed).normal(size=(5, 12))
    expected = LOAD.wrench(motion[:, :3], motion[:, 6:9], motion[:, 9:])
    np.testing.assert_allclose(regressor(motion) @ LOAD.barycentric(), expected, atol=1e-10)


def test_every_robot_sees_the_same_body() -> None:
    rng = np.random.default_rng(0)
    team = grasps(rng)
    motions = body_motions(exact_signals(rng, team), team)
    np.testing.assert_allclose(motions[1], motions[0], atol=1e-10)
    np.testing.assert_allclose(motions[2], motions[0], atol=1e-10)


@pytest.mark.parametrize("count", [2, 3, 5])
def test_both_fits_are_exact_without_noise(count: int) -> None:
    rng = np.random.default_rng(count)
    team = grasps(rng, count)
    signals = exact_signals(rng, team)
    motions, wrench = body_motions(signals, team), total_wrench(signals.wrench, team)
    np.testing.assert_allclose(fit_parameters(motions, wrench, RATE).solution, LOAD.barycentric(), atol=1e-8)
    np.testing.assert_allclose(
        fit_tensor(motions[0], wrench, LOAD.com, RATE).solution, pack_symmetric(LOAD.tensor), atol=1e-8
    )
    np.testing.assert_allclose(parameters_fit(signals, team)[0], LOAD.central(), atol=1e-8)


def test_wrenches_that_cancel_are_refused() -> None:
    rng = np.random.default_rng(1)
    team = grasps(rng)
    motions = body_motions(exact_signals(rng, team), team)
    with pytest.raises(RecordingError, match="wrenches of all robots cancel all the time"):
        fit_parameters(motions, np.zeros((motions.shape[1], 6)), RATE)


def test_instruments_remove_the_bias_of_inertia() -> None:
    """Least squares loses the share of noise in the acceleration's square; with instruments nothing is lost."""
    rng = np.random.default_rng(2)
    team = grasps(rng)
    exact = exact_signals(rng, team)
    size = 0.3 * float(np.sqrt(np.mean(exact.motion[..., BODY_ALPHA] ** 2)))
    trace = np.trace(LOAD.tensor)
    plain, instrumental = [], []
    for _ in range(40):
        noisy = with_noise(rng, exact, w=0.0, v=0.0, alpha=size, a=0.0)
        motions, wrench = body_motions(noisy, team), total_wrench(noisy.wrench, team)
        plain.append(float(fit_tensor(motions[0], wrench, LOAD.com, RATE).solution[:3].sum() / trace - 1.0))
        fit = fit_parameters(motions, wrench, RATE)
        instrumental.append(float(np.trace(Inertia.from_barycentric(fit.solution).tensor) / trace - 1.0))
    assert np.mean(plain) == pytest.approx(-(0.3**2) / (1 + 0.3**2), rel=0.3)
    assert abs(np.mean(instrumental)) < 3.5 * np.std(instrumental) / np.sqrt(40.0)


def test_bias_of_the_tensor_is_known_and_its_covariance_is_that_of_noise() -> None:
    """Residuals of the biased tensor would count the bias as noise, and make the covariance several times too large."""
    rng = np.random.default_rng(6)
    team = grasps(rng)
    exact = exact_signals(rng, team)
    size = 0.3 * float(np.sqrt(np.mean(exact.motion[..., BODY_ALPHA] ** 2)))
    biases, errors, squares = [], [], []
    for _ in range(40):
        noisy = with_noise(rng, exact, w=0.0, v=0.0, alpha=size, a=0.0)
        motions, wrench = body_motions(noisy, team), total_wrench(noisy.wrench, team)
        tensor = fit_tensor(motions[0], wrench, LOAD.com, RATE).solution
        bias, covariance = bias_of_tensor(motions, wrench, LOAD.com, RATE, tensor)
        error = tensor - pack_symmetric(LOAD.tensor)
        biases.append(bias)
        errors.append(error)
        squares.append(float((error - bias) @ np.linalg.solve(covariance, error - bias)) / 6.0)
    np.testing.assert_allclose(np.mean(biases, axis=0), np.mean(errors, axis=0), atol=0.15 * np.abs(errors).max())
    assert 0.6 < np.mean(squares) < 1.7


def test_covariance_says_how_much_parameters_scatter() -> None:
    rng = np.random.default_rng(3)
    team = grasps(rng)
    exact = exact_signals(rng, team)
    squares = []
    for _ in range(60):
        noisy = with_noise(rng, exact, w=0.0, v=0.0, alpha=0.3, a=0.05)
        numbers, covariance, _ = parameters_fit(noisy, team)
        error = numbers - LOAD.central()
        squares.append(float(np.mean(error**2 / np.diag(covariance))))
    assert 0.7 < np.mean(squares) < 1.5


def test_derivative_by_poses_predicts_a_fit_with_other_poses() -> None:
    rng = np.random.default_rng(4)
    team = grasps(rng)
    # Without noise the weights would be all about the poses' error.
    signals = with_noise(rng, exact_signals(rng, team), w=0.0, v=0.0, alpha=0.3, a=0.3)
    derivative = derivative_by_poses(lambda poses: parameters_fit(signals, poses)[0], team)
    assert not derivative[:, :6].any()
    moved = 3e-4 * rng.normal(size=6)
    changed = (team[0], Pose(rotation_exp(moved[:3]) @ team[1].rotation, team[1].translation + moved[3:]), team[2])
    change = parameters_fit(signals, changed)[0] - parameters_fit(signals, team)[0]
    np.testing.assert_allclose(derivative[:, 6:12] @ moved, change, atol=0.02 * np.abs(change).max())


@given(rotations)
def test_principal_inertia_is_ascending_and_right_handed(rotation: Array) -> None:
    tensor = rotation @ np.diag([3.0, 1.0, 2.0]) @ rotation.T
    moments, axes, std = principal_inertia(tensor, -1e-20 * np.eye(6))
    np.testing.assert_allclose(moments, [1.0, 2.0, 3.0], atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    np.testing.assert_allclose(axes @ np.diag(moments) @ axes.T, tensor, atol=1e-12)
    assert (std == 0.0).all()


def test_standard_deviations_of_moments_follow_the_inertias() -> None:
    rng = np.random.default_rng(5)
    root = 0.01 * rng.normal(size=(6, 6))
    _, _, std = principal_inertia(LOAD.tensor, root @ root.T)
    samples = LOAD.central()[4:] + rng.normal(size=(20000, 6)) @ root.T
    tensors = [of_central_numbers(np.concatenate([np.ones(4), row])).tensor for row in samples]
    np.testing.assert_allclose(np.std(np.linalg.eigvalsh(tensors), axis=0), std, rtol=0.05)


def test_impossible_bodies_are_made_possible_and_said_so() -> None:
    impossible = replace(LOAD, tensor=np.diag([1.0, 1.0, 2.5]))  # the largest moment exceeds the others' sum
    places = grasps(np.random.default_rng(6))
    covariance = np.diag([1e-4] * 4 + [1e-2] * 6)
    found = make_payload(impossible, covariance, places)
    assert not found.was_possible
    assert np.linalg.eigvalsh(found.inertia.pseudo_inertia())[0] > 0.0
    assert make_payload(LOAD, covariance, places).was_possible


def test_inertia_is_unobservable_if_only_a_product_of_it_is() -> None:
    places = grasps(np.random.default_rng(6))
    assert make_payload(LOAD, np.diag([1e-4] * 10), places).is_seen("inertia")
    found = make_payload(LOAD, np.diag([1e-4] * 7 + [1e4] + [1e-4] * 2), places)
    assert [part.what for part in found.unobservable] == ["products of inertia"]
    assert found.is_seen("mass")
    assert found.is_seen("com")
    assert not found.is_seen("inertia")


def resting(team: tuple[Pose, ...], directions: Array, rng: np.random.Generator) -> Holds:
    """Exact holds with gravity along these directions (H, 3) of the first grasp frame."""
    down = 9.81 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    still = np.zeros_like(down)
    total = LOAD.wrench(still, -down, still)
    pushes = rng.normal(size=(len(team) - 1, len(down), 6))
    shares = [total - pushes.sum(axis=0), *pushes]
    wrench = [share @ np.linalg.inv(pose.adjoint()).T for share, pose in zip(shares, team, strict=True)]
    return Holds(
        spans=tuple((10.0 * k, 10.0 * k + 7.0) for k in range(len(down))),
        down=np.stack([down @ pose.rotation for pose in team], axis=1),
        wrench=np.stack(wrench, axis=1),
        scatter=np.full((len(down), len(team), 6), 1e-4),
    )


@given(seeds)
def test_static_estimate_is_exact_from_two_orientations_on(seed: int) -> None:
    rng = np.random.default_rng(seed)
    team = grasps(rng)
    directions = np.vstack([[0.0, 0.0, -1.0], [0.3, 0.0, -1.0], rng.normal(size=(2, 3))])
    for count in (2, 4):
        found, covariance = static_estimate(resting(team, directions[:count], rng), team)
        np.testing.assert_allclose(found, [LOAD.mass, *LOAD.com], rtol=1e-6, atol=1e-9)
        assert np.linalg.eigvalsh(covariance)[0] > 0.0


def test_mass_and_centre_of_mass_at_rest_have_the_noise_of_each_force() -> None:
    """A force far away causes moments across its arm only, and is in the mass, too; few residuals are no more noise."""
    rng = np.random.default_rng(9)
    team = (Pose.identity(), Pose(np.eye(3), np.array([4.0, 0.0, 0.0])))
    exact = resting(team, rng.normal(size=(6, 3)), rng)
    scatter = np.zeros_like(exact.scatter)
    scatter[:, 1, :3] = 0.3**2
    squares = []
    for _ in range(300):
        noise = np.sqrt(scatter) * rng.normal(size=scatter.shape)
        found, spread = static_estimate(replace(exact, wrench=exact.wrench + noise, scatter=scatter), team)
        error = found - [LOAD.mass, *LOAD.com]
        squares.append([*error**2 / np.diag(spread), error @ np.linalg.solve(spread, error) / 4.0])
    np.testing.assert_allclose(np.mean(squares, axis=0), 1.0, atol=0.3)


def test_residuals_at_rest_that_are_no_chance_count() -> None:
    rng = np.random.default_rng(10)
    team = grasps(rng)
    exact = resting(team, rng.normal(size=(12, 3)), rng)
    noise = 0.5 * rng.normal(size=exact.wrench.shape)
    _, found = static_estimate(replace(exact, wrench=exact.wrench + noise), team)
    _, calm = static_estimate(exact, team)
    assert (np.diag(found) > 30.0 * np.diag(calm)).all()


def test_one_orientation_is_not_enough_and_said_so() -> None:
    rng = np.random.default_rng(7)
    team = grasps(rng)
    same = np.array([[0.0, 0.0, -1.0], [0.0, 0.01, -1.0], [0.0, 0.0, -2.0]])
    assert orientations(same) == 1
    with pytest.raises(RecordingError, match=r"at least 2 orientations.*found 1 in 3 holds: 0.0 to 7.0 s, 10.0 to"):
        static_estimate(resting(team, same, rng), team)


def test_holds_are_found_where_no_force_changes() -> None:
    rng = np.random.default_rng(8)
    time = np.arange(4000) / RATE
    forces = 10.0 * np.sin(2.0 * np.pi * 0.7 * time)[None, :, None] * np.ones((3, 1, 3))
    forces[:, 500:1300] = 5.0
    forces[:, 2000:2400] = -4.0  # too short
    forces[:, 3000:3900] = 2.0
    forces[1, 3000:3900, 2] += np.linspace(0.0, 3.0, 900)  # one force of one robot creeps
    forces += 0.6 * rng.normal(size=forces.shape)
    (found,) = find_holds(forces, time)
    assert abs(found[0] - 500) < 100
    assert abs(found[1] - 1300) < 100
    assert find_holds(forces[:, :550], time[:550]) == []


@pytest.mark.parametrize("count", [600, 601, 2500])
@pytest.mark.parametrize("rate", [100.0, 87.5])
def test_holds_are_stretches_of_windows_in_which_forces_vary_by_less_than_a_newton(count: int, rate: float) -> None:
    rng = np.random.default_rng(count)
    time = np.arange(count) / rate
    # Small steps at random times, so that about every second window is steady.
    forces = np.cumsum(0.9 * rng.normal(size=(2, count, 3)) * (rng.uniform(size=(2, count, 3)) < 0.0007), axis=1)
    length, smoothing = round(6.0 * rate), round(rate)
    smooth = uniform_filter1d(forces, smoothing, axis=1)
    covered = np.zeros(count, dtype=np.bool_)
    for start in range(count - length + 1):
        if (np.ptp(smooth[:, start : start + length], axis=1) < 1.0).all():
            covered[start : start + length] = True
    found = np.zeros(count, dtype=np.bool_)
    for start, end in find_holds(forces, time):
        found[start:end] = True
    np.testing.assert_array_equal(found, covered)


def test_slow_recordings_have_holds_with_a_lower_cutoff() -> None:
    """Eight samples a second cannot be filtered at the 5 Hz that are the default."""
    recording = moving_recording(np.random.default_rng(9), grasps(np.random.default_rng(10)), seconds=120.0)
    robots = {}
    for name, robot in recording.robots.items():
        assert robot.pose is not None
        pose = robot.pose[::12]
        lift = Rotation.from_quat(pose[:, 3:]).inv().apply([0.0, 0.0, 30.0])
        robots[name] = RobotRecord(robot.time[::12], pose=pose, wrench=np.hstack([lift, np.zeros_like(lift)]))
    slow = replace(recording, robots=robots, holds=((10.0, 10.5), (40.0, 40.5)))
    with pytest.raises(RecordingError, match=r"cannot be filtered at 5 Hz: .* a --cutoff below 4"):
        identify_batch(slow)
    holds = identify_batch(slow, cutoff=3.0).holds
    assert holds is not None
    assert len(holds.spans) == 2
