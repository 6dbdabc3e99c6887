"""The first state: in closed form, exact on exact rows, and a guess where the motion shows nothing."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.estimation.geometry.body_motion import perturbation_between
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.moments.fit_settings import FitSettings, Guess
from coheft.estimation.moments.moments import RowMoments, evaluated_moments
from coheft.estimation.moments.rows import RowNoise
from coheft.estimation.moments.start import first_load, first_poses
from coheft.estimation.moments.unknowns import State
from tests.estimation.moments.fitting import IDEAL
from tests.estimation.moments.moving_team import EXACT, NOISE, PERIOD, Team, make_team

QUIET = RowNoise(1e-4 * NOISE.kinematics, 1e-4 * NOISE.wrench)


def errors_of_poses(team: Team, rows: Array, anchor: int, noise: RowNoise) -> Array:
    """Of poses that are all unknown but the anchor's, shape (N, 6) [rad, m]."""
    poses = [Pose.identity()] * team.count
    poses[anchor] = team.poses[anchor]
    is_unknown = np.arange(team.count) != anchor
    found = first_poses(RowMoments.of(rows), State.first(poses, EXACT), FitSettings(noise, PERIOD), is_unknown)
    return np.array([perturbation_between(*pair) for pair in zip(team.poses, found.poses, strict=True)])


def loaded(team: Team, rows: Array, settings: FitSettings = IDEAL) -> tuple[Array, Guess]:
    """The first load at the true poses, and what was guessed before."""
    moments, state = RowMoments.of(rows), team.state().with_load(None)
    body = settings.body(state)
    guess = Guess.of(body, moments)
    state = first_load(state, evaluated_moments(body, moments, moments).wrench, guess, settings)
    assert state.load is not None
    return state.load, guess


@pytest.mark.parametrize("count", [2, 3, 6])
@pytest.mark.parametrize("anchor", [0, 1])
def test_exact_rows_show_exact_poses(count: int, anchor: int) -> None:
    team = make_team(seed=count, count=count)
    np.testing.assert_allclose(errors_of_poses(team, team.rows, anchor, QUIET), 0.0, atol=1e-6)


GYRO, VELOCITY, ACCELERATION = [0, 1, 2, 9, 10, 11], [3, 4, 5], [6, 7, 8]


@pytest.mark.parametrize(
    "missing",
    [
        {1: GYRO},
        {1: VELOCITY},
        {1: ACCELERATION},
        {1: GYRO + VELOCITY},
        {1: GYRO + ACCELERATION},
        {0: VELOCITY, 1: GYRO, 2: ACCELERATION},  # r3 has no sensor in common with r1 that shows where it is
        {0: VELOCITY, 1: VELOCITY, 2: VELOCITY},
    ],
)
def test_exact_rows_show_exact_poses_of_robots_without_a_sensor(missing: dict[int, list[int]]) -> None:
    team = make_team(seed=3)
    rows, kinematics = team.rows.copy(), np.repeat(QUIET.kinematics, 3, axis=0)
    for robot, indices in missing.items():
        kinematics[robot, indices] = np.inf
        rows[:, 24 * robot + np.array(indices)] = 0.0
        if 0 in indices:
            rows[:, 24 * robot + 18 : 24 * robot + 24] = 0.0
    found = errors_of_poses(team, rows, 0, RowNoise(kinematics, QUIET.wrench))
    np.testing.assert_allclose(found, 0.0, atol=1e-4)


def test_robots_on_a_line_too() -> None:
    team = make_team(seed=1, count=4, on_a_line=True)
    np.testing.assert_allclose(errors_of_poses(team, team.rows, 2, QUIET), 0.0, atol=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_noisy_rows_show_poses_from_which_steps_are_nearly_linear(seed: int) -> None:
    team = make_team(seed, number=50)
    found = errors_of_poses(team, team.noisy(np.random.default_rng(seed)), 0, NOISE)
    assert np.abs(found[:, :3]).max() < np.radians(5.0)
    assert np.abs(found[:, 3:]).max() < 0.1


def test_constant_offsets_of_gyros_and_velocities_do_not_matter() -> None:
    team, rows = make_team(seed=2), make_team(seed=2).rows.copy()
    rows[:, :-1].reshape(len(rows), 3, 24)[:, :, :6] += 0.1 * np.random.default_rng(3).normal(size=(3, 6))
    np.testing.assert_allclose(errors_of_poses(team, rows, 0, QUIET), 0.0, atol=1e-6)


def test_poses_that_are_known_stay() -> None:
    team = make_team(seed=4, count=4)
    poses = [*team.poses[:2], Pose.identity(), team.poses[3]]
    state = State.first(poses, EXACT)
    found = first_poses(
        RowMoments.of(team.rows), state, FitSettings(QUIET, PERIOD), np.array([False, False, True, False])
    )
    for i in (0, 1, 3):
        assert found.poses[i] is poses[i]
    np.testing.assert_allclose(found.poses[2].numbers(), team.poses[2].numbers(), atol=1e-6)


def test_a_noisier_robot_needs_its_own_noise() -> None:
    team = make_team(seed=5)
    noise = RowNoise(NOISE.kinematics * np.array([[1.0], [1.0], [3.0]]), NOISE.wrench)
    found = errors_of_poses(team, team.noisy(np.random.default_rng(6), noise), 0, noise)
    assert np.abs(found).max() < 0.1


def test_where_nothing_turns_places_are_not_far_away() -> None:
    team = make_team(seed=7, turning=0.0)
    found = errors_of_poses(team, team.noisy(np.random.default_rng(8)), 0, NOISE)
    distances = np.linalg.norm([pose.translation - team.poses[0].translation for pose in team.poses], axis=1)
    # Held at the anchor's place: the error is about the distance.
    assert (np.linalg.norm(found[:, 3:], axis=1) < 1.5 * distances + 0.1).all()
    assert np.abs(found[1:, :3]).max() < np.radians(20.0)


def test_without_any_noise_and_any_motion_there_is_still_a_state() -> None:
    team = make_team(seed=7, turning=0.0, moving=0.0)
    found = errors_of_poses(team, team.rows, 0, NOISE)
    assert np.abs(found[:, 3:]).max() < 2.0


def test_at_rest_gravity_shows_how_grasps_are_tilted() -> None:
    team = make_team(seed=8, turning=0.0, moving=0.0)
    rows, anchor = team.noisy(np.random.default_rng(9)), team.poses[0]
    poses = [anchor, *(Pose.identity(),) * 2]
    found = first_poses(RowMoments.of(rows), State.first(poses, EXACT), IDEAL, np.arange(3) > 0).poses
    down = [pose.rotation @ rows[:, 24 * i + 6 : 24 * i + 9].mean(axis=0) for i, pose in enumerate(found)]
    np.testing.assert_allclose(down[1:], [down[0]] * 2, atol=0.1)


def test_exact_rows_show_the_exact_load() -> None:
    team = make_team(seed=9)
    settings = FitSettings(QUIET, PERIOD)
    load, _ = loaded(team, team.rows, settings)
    np.testing.assert_allclose(load, team.load, atol=1e-5)
    team = make_team(seed=9, offset=3.0)
    load, _ = loaded(team, team.rows, FitSettings(QUIET, PERIOD, force_offset=3.0, torque_offset=0.3))
    np.testing.assert_allclose(load, team.load, atol=1e-4)


def test_noisy_rows_show_a_load_that_is_nearly_right() -> None:
    team = make_team(seed=10)
    load, guess = loaded(team, team.noisy(np.random.default_rng(11)))
    assert np.abs((load - team.load)[6:] / guess.limits).max() < 0.2
    assert not load[:6].any()  # no sensor has an offset


def test_what_the_motion_does_not_show_remains_a_guess() -> None:
    team = make_team(seed=12, turning=0.0, moving=0.0)
    load, guess = loaded(team, team.noisy(np.random.default_rng(13)))
    assert load[6] == pytest.approx(team.load[6], rel=0.01)
    np.testing.assert_allclose(load[10:], guess.theta[4:], atol=0.05)
