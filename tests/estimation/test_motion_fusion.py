"""Fusion of all robots' sensors: exact without noise, honest with it, and completed by the gyro's derivative."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from coheft.estimation.body_motion import BODY_A, BODY_ALPHA, BODY_V, BODY_W, grasp_measurements
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.motion_fusion import carried_constants, derivative, derivative_kernel, robot_constants
from coheft.estimation.spatial import Array
from tests.estimation.fusion import fusion_of, summed
from tests.estimation.team import Team, make_team, random_pose


def motion_at(team: Team, i: int) -> Array:
    """True motion (n, 12) of ``F_i``."""
    kinematics = grasp_measurements(team.poses[i], team.motion)
    return np.concatenate([kinematics, team.motion[:, BODY_ALPHA] @ team.poses[i].rotation], axis=1)


@pytest.mark.parametrize("i", [0, 2])
def test_exact_sensors_give_the_exact_motion_in_every_frame(i: int) -> None:
    team = make_team(seed=1, count=5, duration=1.0)
    motion = fusion_of(team, i).motion(summed(team, team.exact, i))
    np.testing.assert_allclose(motion, motion_at(team, i), atol=1e-9)


def test_constants_are_carried_from_frame_to_frame() -> None:
    rng = np.random.default_rng(2)
    pose_j_in_i, pose_k_in_j = random_pose(rng), random_pose(rng)
    at_k = robot_constants(SensorNoise())
    by_way_of_j = carried_constants(carried_constants(at_k, pose_k_in_j), pose_j_in_i)
    np.testing.assert_allclose(by_way_of_j, carried_constants(at_k, pose_j_in_i @ pose_k_in_j), rtol=1e-9, atol=1e-6)


def test_covariances_are_those_of_the_errors() -> None:
    team = make_team(seed=3, rate=50.0)
    fusion = fusion_of(team)
    sums = summed(team, team.measured(np.random.default_rng(3)))
    error = fusion.motion(sums) - team.motion
    acceleration = np.concatenate([error[:, BODY_A], error[:, BODY_ALPHA]], axis=1)
    velocity = np.concatenate([error[:, BODY_V], error[:, BODY_W]], axis=1)
    wrench = sums[:, 0] - team.inertia.wrench(
        team.motion[:, BODY_W], team.motion[:, BODY_A], team.motion[:, BODY_ALPHA]
    )
    low, high = chi2.ppf([0.0005, 0.9995], error.shape[0] * 6)
    for errors, covariance in (
        (acceleration, fusion.acceleration_covariance),
        (velocity, fusion.velocity_covariance),
        (wrench, fusion.wrench_covariance),
    ):
        assert low < np.sum(errors.T * np.linalg.solve(covariance, errors.T)) < high


def test_many_accelerometers_need_no_derivative_and_two_need_it_about_their_line() -> None:
    assert fusion_of(make_team(seed=4, count=3)).derivative_gain is None
    pair = make_team(seed=4, count=2)
    gain = fusion_of(pair).derivative_gain
    assert gain is not None
    line = pair.poses[1].translation / np.linalg.norm(pair.poses[1].translation)
    across = np.linalg.svd(line[None])[2][1:]
    np.testing.assert_allclose(across @ gain, 0.0, atol=1e-9 * np.abs(gain).max())
    with pytest.raises(ValueError, match="w_derivative"):
        fusion_of(pair).motion(summed(pair, pair.exact))


def test_one_robot_takes_all_of_alpha_from_its_gyro() -> None:
    team = make_team(seed=5, count=1, duration=2.0, rate=200.0)
    fusion, kernel = fusion_of(team, period=0.005), derivative_kernel(4, 0.005)
    sums = summed(team, team.exact)
    alpha = derivative(fusion.angular_velocity(sums), kernel)
    motion = fusion.motion(sums[4:-4], alpha)
    np.testing.assert_allclose(motion, team.motion[4:-4], atol=1e-3 * np.abs(team.motion).max())
    np.testing.assert_allclose(motion[:, BODY_ALPHA], alpha, atol=1e-9)


def test_derivative_is_exact_for_cubics_and_nearly_so_for_what_robots_do() -> None:
    time = 0.01 * np.arange(30)
    cubic = np.stack([time, time**2, time**3], axis=1)
    kernel = derivative_kernel(3, 0.01)
    slope = np.stack([np.ones_like(time), 2 * time, 3 * time**2], axis=1)[3:-3]
    np.testing.assert_allclose(derivative(cubic, kernel), slope, atol=1e-12)
    rate = 2 * np.pi * 1.6
    lost = derivative(np.sin(rate * time)[:, None], kernel)[:, 0] / (rate * np.cos(rate * time[3:-3])) - 1.0
    assert np.abs(lost).max() < (rate * 0.03) ** 4 / 350
