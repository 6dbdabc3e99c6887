"""Angular acceleration from neighbours' accelerometers, and from the gyro where these are blind."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coheft.estimation.fan2017.angular_acceleration import AngularAcceleration, gyro_derivative
from coheft.estimation.geometry.spatial import Array, Pose, rotation_exp
from coheft.estimation.measurement import ACCELERATION, GYRO, SensorNoise
from tests.estimation.team import make_team
from tests.rigid_motions import vectors

NOISE = SensorNoise()
RATE = 100.0


@given(vectors(5.0), vectors(5.0), vectors(5.0), st.integers(2, 20))
def test_gyro_derivative_is_exact_up_to_constant_jerk(w: Array, alpha: Array, jerk: Array, size: int) -> None:
    t = np.arange(-1, size + 1)[:, None] / RATE
    gyro = w + alpha * t + 0.5 * jerk * t**2
    found = gyro_derivative(gyro[0], gyro[1:-1], gyro[-1], RATE)
    np.testing.assert_allclose(found, (alpha + jerk * t)[1:-1], atol=1e-10)


@pytest.mark.parametrize("count", [2, 3, 6])
@pytest.mark.parametrize("seed", range(3))
def test_exact_data_give_the_exact_acceleration(count: int, seed: int) -> None:
    team = make_team(seed, count=count, duration=1.0)
    estimator = AngularAcceleration(team.poses[1:], NOISE, RATE)
    others = [team.exact[:, i, ACCELERATION] for i in range(1, count)]
    alpha = team.motion[:, 9:]
    found = estimator.estimate(alpha, team.exact[:, 0, GYRO], team.exact[:, 0, ACCELERATION], others)
    np.testing.assert_allclose(found, alpha, atol=1e-9)


def test_without_accelerometers_it_is_the_gyro_s_derivative() -> None:
    team = make_team(1, count=3, duration=1.0)
    estimator = AngularAcceleration(team.poses[1:], NOISE, RATE, with_accelerometers=False)
    others = [team.exact[:, i, ACCELERATION] for i in range(1, 3)]
    derivative = team.motion[:, 9:] + 0.1
    found = estimator.estimate(derivative, team.exact[:, 0, GYRO], team.exact[:, 0, ACCELERATION], others)
    np.testing.assert_allclose(found, derivative, atol=1e-12)
    np.testing.assert_allclose(estimator.covariance, (NOISE.gyro * RATE) ** 2 / 2.0 * np.eye(3))


@pytest.mark.parametrize("seed", range(3))
def test_one_neighbour_leaves_one_direction_to_the_gyro(seed: int) -> None:
    team = make_team(seed, count=2, duration=1.0)
    estimator = AngularAcceleration(team.poses[1:], NOISE, RATE)
    p = team.poses[1].translation
    along = p / np.linalg.norm(p)
    across = np.cross(along, [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    alpha, own, other = team.motion[:, 9:], team.exact[:, 0], team.exact[:, 1, ACCELERATION]

    def error(gyro_error: Array) -> Array:
        found: Array = estimator.estimate(alpha + gyro_error, own[:, GYRO], own[:, ACCELERATION], [other])
        return found - alpha

    np.testing.assert_allclose(error(along), np.tile(along, (len(alpha), 1)), atol=1e-9)
    gyro_variance = (NOISE.gyro * RATE) ** 2 / 2.0
    array_variance = 2.0 * NOISE.acceleration**2 / (p @ p)
    share = array_variance / (array_variance + gyro_variance)
    np.testing.assert_allclose(error(across), np.tile(share * across, (len(alpha), 1)), atol=1e-9)
    np.testing.assert_allclose(along @ estimator.covariance @ along, gyro_variance)
    np.testing.assert_allclose(across @ estimator.covariance @ across, share * gyro_variance)


@pytest.mark.parametrize("count", [2, 6])
def test_covariance_is_that_of_the_errors(count: int) -> None:
    team = make_team(1, count=count, duration=60.0)
    estimator = AngularAcceleration(team.poses[1:], NOISE, RATE)
    rng = np.random.default_rng(2)
    own, *others = (team.measured(rng)[:, i] for i in range(count))
    # Every third sample, so that the differences share no gyro sample; w x (w x p) adds noise of a few percent.
    alpha, inner = team.motion[:, 9:], slice(1, -1, 3)
    noise_free_derivative = gyro_derivative(
        team.exact[0, 0, GYRO], team.exact[1:-1, 0, GYRO], team.exact[-1, 0, GYRO], RATE
    )
    derivative = gyro_derivative(own[0, GYRO], own[1:-1, GYRO], own[-1, GYRO], RATE)
    derivative += alpha[1:-1] - noise_free_derivative  # leave out what differencing smooths
    found = estimator.estimate(
        derivative, own[1:-1, GYRO], own[1:-1, ACCELERATION], [other[1:-1, ACCELERATION] for other in others]
    )
    errors = (found - alpha[1:-1])[inner]
    whitened = np.linalg.solve(np.linalg.cholesky(estimator.covariance), errors.T)
    np.testing.assert_allclose(np.cov(whitened), np.eye(3), atol=0.15)


@pytest.mark.parametrize("seed", range(3))
def test_a_pose_error_changes_it_as_the_derivative_says(seed: int) -> None:
    team, rng, tiny = make_team(seed, count=3, duration=0.2), np.random.default_rng(seed), 1e-6
    others = [team.exact[:, i, ACCELERATION] for i in (1, 2)]
    gyro, own, alpha = team.exact[:, 0, GYRO], team.exact[:, 0, ACCELERATION], team.motion[:, 9:]
    error = rng.normal(size=6)
    moved = Pose(rotation_exp(tiny * error[:3]), tiny * error[3:])
    off = [moved.inverse() @ pose for pose in team.poses[1:]]
    found = AngularAcceleration(off, NOISE, RATE).estimate(alpha, gyro, own, others)
    derivative = AngularAcceleration(team.poses[1:], NOISE, RATE).by_pose_error(gyro, alpha, others)
    # The gyro's share, some thousandths, is not of the derivative.
    np.testing.assert_allclose((found - alpha) / tiny, derivative @ error, rtol=0.02, atol=0.02)
