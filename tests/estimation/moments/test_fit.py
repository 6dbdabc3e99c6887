"""Fits: they come to the truth, know how far from it they are, and depend on nothing that does not matter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from coheft.estimation.geometry.spatial import Array, Pose, rotation_exp
from coheft.estimation.moments.body import BodyModel
from coheft.estimation.moments.evidence import Evidence
from coheft.estimation.moments.fit import Estimate, fit_state
from coheft.estimation.moments.fit_settings import POSE_LIMITS, FitSettings, Guess
from coheft.estimation.moments.moments import RowMoments, evaluated_moments
from coheft.estimation.moments.rows import RowNoise
from coheft.estimation.moments.sensor_errors import SensorErrors
from coheft.estimation.moments.unknowns import State, Unknowns
from tests.estimation.moments.fitting import IDEAL, Fitted, buffer_of, erring, fit, fit_from, normalised_error
from tests.estimation.moments.moving_team import NOISE, PERIOD, Team, make_team

SENSORS = SensorErrors({"acceleration_bias": 0.05, "force_gain": 0.01, "velocity_gain": 0.01, "gyro_gain": 0.005})
DELAYS = SensorErrors({"acceleration_bias": 0.05, "clock": 0.0005, "wrench_delay": 0.0005})
LIMP = SensorErrors({"acceleration_bias": 0.05, "force_gain": 0.01, "grasp_compliance": 1e-4})
SETTINGS = {
    "ideal": IDEAL,
    "errors": replace(IDEAL, errors=SENSORS),
    "delays": replace(IDEAL, errors=DELAYS),
    "compliance": replace(IDEAL, errors=LIMP),
    "offsets": replace(IDEAL, force_offset=2.0, torque_offset=0.2, gyro_offset=0.005),
}
QUIET = RowNoise(1e-5 * NOISE.kinematics, 1e-5 * NOISE.wrench)


def deviations_of(found: Fitted, settings: FitSettings = IDEAL, anchor: int = 0) -> tuple[Array, Array]:
    """Which unknowns a fit moves, and their standard deviations."""
    free = settings.free(found.estimate.body.unknowns, anchor, with_load=True)
    return free, np.sqrt(found.estimate.covariance.diagonal()[free])


def assert_near(error: Array, found: Fitted, most: float, settings: FitSettings = IDEAL, anchor: int = 0) -> None:
    free, deviations = deviations_of(found, settings, anchor)
    assert np.abs(error[free] / deviations).max() < most


def difference(one: Fitted, other: Fitted, team: Team) -> Array:
    """Step (u,) from the first estimate to the second one, in the frame of the first robot."""
    states = (one.estimate.state, other.estimate.state)
    first, second = (
        replace(team, poses=state.poses, load=state.load).expressed_in(state.poses[0]).state() for state in states
    )
    return second.since(first, one.estimate.body.unknowns)


@pytest.mark.parametrize("count", [2, 3, 6])
@pytest.mark.parametrize("seed", range(3))
def test_a_fit_comes_to_the_truth(count: int, seed: int) -> None:
    team = make_team(seed, count=count)
    found = fit(team.noisy(np.random.default_rng(seed)))
    assert not found.estimate.hidden_poses().any()
    assert_near(found.error(team), found, 5.0)
    assert np.degrees(deviations_of(found)[1][:3]).max() < 2.0


def test_exact_rows_give_the_exact_state() -> None:
    team, settings = make_team(seed=1), replace(IDEAL, noise=QUIET)
    np.testing.assert_allclose(fit(team.rows, settings).error(team), 0.0, atol=1e-7)


@pytest.mark.parametrize("kind", SETTINGS)
@pytest.mark.parametrize("count", [2, 4])
def test_a_fit_knows_how_far_from_the_truth_it_is(kind: str, count: int) -> None:
    settings, found = SETTINGS[kind], []
    for seed in range(12 if settings.errors.count else 20):
        rng = np.random.default_rng(seed + 100)
        state, rows = erring(make_team(seed, count=count, number=120), settings, rng)
        result = fit(rows, settings)
        error = state.since(result.estimate.state, result.estimate.body.unknowns)
        assert_near(error, result, 5.0, settings)
        found.append(normalised_error(error, result.estimate, settings))
    assert 0.7 < np.mean(found) < 1.4


def test_robots_on_a_line() -> None:
    team = make_team(seed=2, count=4, on_a_line=True)
    found = fit(team.noisy(np.random.default_rng(3)))
    assert_near(found.error(team), found, 5.0)


def test_the_anchor_does_not_matter() -> None:
    team = make_team(seed=4)
    rows = team.noisy(np.random.default_rng(5))
    one, other = fit(rows, anchor=0), fit(rows, anchor=2)
    assert other.estimate.state.poses[2].numbers() == pytest.approx(Pose.identity().numbers())
    assert_near(difference(one, other, team), one, 0.05)
    for robot, found in ((0, one), (2, other)):
        assert not found.estimate.covariance[found.estimate.body.unknowns.poses[robot]].any()


def refined(found: Fitted, frame: Pose, team: Team) -> Fitted:
    """The same fit once more, in another body frame and until nothing moves any more."""
    estimate = found.estimate
    now = replace(team, poses=estimate.state.poses, load=estimate.state.load).expressed_in(frame)
    guess = replace(found.estimate.guess, theta=now.load[6:])
    evaluate, settings = found.chapter.evaluation(), IDEAL
    state = now.state()
    for _ in range(4):
        estimate = fit_state(state, evaluate, found.chapter.prior_evidence, guess, settings, 0, most_steps=3)
        state = estimate.state
    return Fitted(estimate, found.chapter)


def test_the_body_frame_does_not_matter() -> None:
    team = make_team(seed=6)
    start = fit(team.noisy(np.random.default_rng(7)))
    frame = Pose(rotation_exp([0.5, -0.2, 1.0]), np.array([0.3, -0.4, 0.2]))
    one, other = refined(start, Pose.identity(), team), refined(start, frame, team)
    assert_near(difference(one, other, team), one, 0.02)
    mass = one.estimate.body.unknowns.theta.start
    variances = [each.estimate.covariance[mass, mass] for each in (one, other)]
    assert variances[0] == pytest.approx(variances[1], rel=1e-3)


@pytest.mark.parametrize("order", [[0, 2, 1, 3], [3, 1, 0, 2]])
def test_the_order_of_robots_does_not_matter(order: Sequence[int]) -> None:
    team = make_team(seed=8, count=4)
    rows = team.noisy(np.random.default_rng(9))
    own = rows[:, :-1].reshape(len(rows), 4, 24)[:, order]
    one = fit(rows, anchor=0)
    other = fit(np.hstack([own.reshape(len(rows), -1), rows[:, -1:]]), anchor=list(order).index(0))
    for index, robot in enumerate(order):
        expected = one.estimate.state.poses[robot].numbers()
        np.testing.assert_allclose(other.estimate.state.poses[index].numbers(), expected, atol=1e-8)
    np.testing.assert_allclose(other.estimate.state.load, one.estimate.state.load, atol=1e-7)
    unknowns = one.estimate.body.unknowns
    indices = np.concatenate([unknowns.poses[order].ravel(), unknowns.common])
    expected = one.estimate.covariance[np.ix_(indices, indices)]
    scale = np.sqrt(np.maximum(expected.diagonal(), 1e-12))
    np.testing.assert_allclose(
        other.estimate.covariance / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-6
    )


@pytest.mark.parametrize("settings", [IDEAL, SETTINGS["errors"]], ids=["ideal", "errors"])
def test_moments_as_seen_from_one_state_give_nearly_the_same(settings: FitSettings) -> None:
    team = make_team(seed=10, count=13, number=260)
    _, rows = erring(team, settings, np.random.default_rng(11))
    exact, projected = fit(rows, settings), fit(rows, settings, is_projected=True)
    assert not isinstance(projected.chapter.buffer.moments()[0], RowMoments)
    apart = projected.estimate.state.since(exact.estimate.state, exact.estimate.body.unknowns)
    assert_near(apart, exact, 0.1, settings)
    ratio = deviations_of(projected, settings)[1] / deviations_of(exact, settings)[1]
    np.testing.assert_allclose(ratio, 1.0, atol=0.02)


def poses_alone(team: Team, rows: Array, start: State, known: float = np.inf) -> Estimate:
    """Fitted to the motion, with poses known before to ``known`` [rad, m] around the first state."""
    moments, guess = RowMoments.of(rows), Guess(team.load[6:], np.abs(team.load[6:]) + 1.0, 0.5)

    def before(body: BodyModel) -> Evidence:
        step = start.since(body.state, body.unknowns)
        indices = body.unknowns.poses.ravel()
        return Evidence.prior(np.full(len(indices), known), step[indices]).embedded(body.unknowns.size, indices)

    return fit_state(start, lambda body: evaluated_moments(body, moments, moments), before, guess, IDEAL, 0)


def test_without_a_load_poses_alone_are_fitted() -> None:
    team = make_team(seed=16)
    unknowns, step = Unknowns(3, IDEAL.errors), np.zeros(6 * 3 + 19)
    step[unknowns.poses[1:]] = 0.02
    rows, truth = team.noisy(np.random.default_rng(17)), team.state().with_load(None)
    found = poses_alone(team, rows, truth.moved(step, unknowns, 6.0))
    assert found.state.load is None
    assert not found.covariance[unknowns.load].any()
    error = truth.since(found.state, unknowns)[unknowns.poses[1:]]
    assert np.abs(error / np.sqrt(found.covariance.diagonal()[unknowns.poses[1:]])).max() < 5.0
    known = poses_alone(team, rows, truth, known=1e-4)
    assert np.abs(truth.since(known.state, unknowns)).max() < 1e-3
    assert (np.sqrt(known.covariance.diagonal()[unknowns.poses]) <= 1e-4).all()


def test_poses_are_hidden_where_nothing_turns() -> None:
    team = make_team(seed=20, turning=0.0)
    start = team.state().with_load(None)
    still = poses_alone(team, team.noisy(np.random.default_rng(21)), start)
    assert still.hidden_poses().tolist() == [False, True, True]
    np.testing.assert_allclose(still.state.poses[1].translation, team.poses[1].translation, atol=0.2)
    team = make_team(seed=20)
    moving = poses_alone(team, team.noisy(np.random.default_rng(21)), start)
    assert not moving.hidden_poses().any()
    assert moving.hidden_poses(1e-6 * POSE_LIMITS).tolist() == [False, True, True]


def test_errors_of_sensors_stay_within_six_of_their_deviations() -> None:
    settings = replace(IDEAL, errors=SensorErrors({"force_gain": 1e-3}))
    team = make_team(seed=18)
    rows = team.noisy(np.random.default_rng(19))
    rows[:, :-1].reshape(len(rows), 3, 24)[:, 1, 12:15] *= 1.5
    found = fit(rows, settings)
    assert np.abs(found.estimate.state.eta).max() <= 6e-3 * (1.0 + 1e-9)


@pytest.mark.parametrize(("number", "turning"), [(40, 0.3), (20, 0.05)])
def test_a_fit_from_far_away_knows_as_much_as_one_from_nearby(number: int, turning: float) -> None:
    team = make_team(seed=24, number=number, turning=turning)
    near = fit(team.noisy(np.random.default_rng(25)))
    step, unknowns = np.zeros(near.estimate.body.unknowns.size), near.estimate.body.unknowns
    step[unknowns.poses[1:]] = 0.2
    step[unknowns.theta] = near.estimate.guess.limits
    far = fit_from(near.estimate.state.moved(step, unknowns, 6.0), near.chapter, IDEAL)
    assert_near(far.estimate.state.since(near.estimate.state, unknowns), near, 0.1)
    np.testing.assert_allclose(deviations_of(far)[1], deviations_of(near)[1], rtol=0.01)


def test_where_sensors_may_err_no_step_is_long() -> None:
    settings = SETTINGS["errors"]
    found = fit(make_team(seed=26).noisy(np.random.default_rng(27)), settings)
    estimate, unknowns = found.estimate, found.estimate.body.unknowns
    step = np.zeros(unknowns.size)
    step[unknowns.poses[1:]] = 0.6
    far = estimate.state.moved(step, unknowns, 6.0)
    evaluate, before = found.chapter.evaluation(), found.chapter.prior_evidence
    once = fit_state(far, evaluate, before, found.estimate.guess, settings, 0, most_steps=1)
    assert 0.2 < np.abs(once.state.since(far, unknowns)[unknowns.poses]).max() < 0.3 + 1e-9


def test_a_fit_from_its_own_result_stays_there() -> None:
    team = make_team(seed=22)
    rows = team.noisy(np.random.default_rng(23))
    once = fit(rows)
    again = fit_from(once.estimate.state, once.chapter, IDEAL)
    assert again.estimate.step < 0.1
    assert_near(again.estimate.state.since(once.estimate.state, once.estimate.body.unknowns), once, 0.05)
    assert buffer_of(rows, IDEAL, 3).load_rows == len(rows)
    assert IDEAL.period == PERIOD
