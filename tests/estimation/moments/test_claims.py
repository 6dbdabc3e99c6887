"""What may be said: as much as the motion shows, and bodies that exist."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from coheft.estimation.geometry.body_motion import perturbed
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.body import BodyModel
from coheft.estimation.moments.claims import CLAIM_LIMITS, Claim, claim_of
from coheft.estimation.moments.evidence import Evidence
from coheft.estimation.moments.fit import Estimate, fit_state
from coheft.estimation.moments.fit_settings import Guess
from coheft.estimation.moments.moments import RowMoments, evaluated_moments
from coheft.estimation.moments.start import first_load
from coheft.estimation.rigid_body.consistency import is_possible, nearest_possible
from coheft.estimation.rigid_body.mass_properties import Inertia, pseudo_inertia
from tests.estimation.moments.fitting import IDEAL
from tests.estimation.moments.moving_team import Team, make_team


def estimate_of(team: Team, seed: int = 0, poses: float = 1e-3) -> Estimate:
    """Of a load, with poses that are known this well [rad, m]."""
    rows, state = team.noisy(np.random.default_rng(seed)), team.state().with_load(None)
    body, moments = IDEAL.body(state), RowMoments.of(rows)
    guess = Guess.of(body, moments)

    def before(body: BodyModel) -> Evidence:
        indices = body.unknowns.poses.ravel()
        step = team.state().since(body.state, body.unknowns)[indices]
        known = Evidence.prior(np.full(len(indices), poses), step).embedded(body.unknowns.size, indices)
        return IDEAL.expected(body) + known

    state = first_load(state, evaluated_moments(body, moments, moments).wrench, guess, IDEAL)
    return fit_state(state, lambda body: evaluated_moments(body, moments, moments), before, guess, IDEAL, 0)


def central(inertia: Inertia | None) -> Array:
    assert inertia is not None
    return inertia.central()


def truth(team: Team, robot: int) -> Array:
    return Inertia.from_barycentric(team.load[6:]).transported(team.poses[robot].inverse()).central()


def assert_true(claim: Claim, team: Team, robot: int) -> None:
    error = (central(claim.inertia) - truth(team, robot))[: claim.known]
    assert claim.covariance.shape == (claim.known, claim.known)
    assert np.abs(error / np.sqrt(claim.covariance.diagonal())).max() < 5.0


@pytest.mark.parametrize("robot", [0, 2])
def test_rich_motion_shows_all_ten_numbers(robot: int) -> None:
    team = make_team(seed=1, number=200)
    claim = claim_of(estimate_of(team), robot)
    assert claim.known == 10
    assert claim.unobservable == ()
    assert not claim.hidden_poses.any()
    assert_true(claim, team, robot)


def test_gravity_alone_shows_the_mass_only() -> None:
    team = make_team(seed=2, turning=0.0, moving=0.0)
    claim = claim_of(estimate_of(team), 1)
    assert claim.known == 1
    assert_true(claim, team, 1)
    assert any(words.startswith("centre of mass") and ": " in words for words in claim.unobservable)
    assert any(words.startswith("inertia") for words in claim.unobservable)


def test_turning_about_one_axis_does_not_show_the_inertia() -> None:
    team = make_team(seed=3, number=200, single_axis=True)
    claim = claim_of(estimate_of(team), 0)
    assert claim.known == 4
    assert_true(claim, team, 0)
    assert claim.unobservable
    assert all(words.startswith("inertia") for words in claim.unobservable)


def test_turning_about_gravity_alone_does_not_show_how_high_the_load_is() -> None:
    team = make_team(seed=4, number=200, single_axis=True, moving=0.0)
    claim = claim_of(estimate_of(team), 0)
    assert claim.known == 1
    assert any(words.startswith("centre of mass along") for words in claim.unobservable)


@pytest.mark.parametrize("robot", [0, 2])
def test_the_covariance_is_that_of_the_load_in_the_robot_s_frame(robot: int) -> None:
    team, step = make_team(seed=5, number=200), 1e-6
    estimate = estimate_of(team)
    state, unknowns = estimate.state, estimate.body.unknowns
    assert state.load is not None
    load = state.load[6:]

    def claimed(perturbation: Array) -> Array:
        pose = perturbed(state.poses[robot], perturbation[:6])
        return Inertia.from_barycentric(load + perturbation[6:]).transported(pose.inverse()).central()

    columns = [(claimed(step * axis) - claimed(-step * axis)) / (2.0 * step) for axis in np.eye(16)]
    derivative, indices = np.array(columns).T, np.r_[unknowns.poses[robot], unknowns.theta]
    expected = derivative @ estimate.covariance[np.ix_(indices, indices)] @ derivative.T
    scale = np.sqrt(expected.diagonal())
    found = claim_of(estimate, robot).covariance
    np.testing.assert_allclose(found / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-5)


def test_where_poses_are_hidden_the_mass_alone_may_be_said() -> None:
    team = make_team(seed=6, number=200)
    estimate, limit = estimate_of(team), CLAIM_LIMITS.min()
    unknowns = estimate.body.unknowns
    hidden = estimate.hidden.copy()
    hidden[unknowns.poses[2, 3], unknowns.poses[2, 3]] = (2.0 * limit) ** 2
    claim = claim_of(replace(estimate, hidden=hidden), 0)
    assert claim.hidden_poses.tolist() == [False, False, True]
    assert claim.known == 1
    assert_true(claim, team, 0)


def test_without_a_load_nothing_is_said() -> None:
    team = make_team(seed=7)
    estimate = estimate_of(team)
    body = IDEAL.body(estimate.state.with_load(None))
    claim = claim_of(replace(estimate, body=body), 0)
    assert claim.inertia is None
    assert claim.known == 0
    assert claim.covariance.shape == (0, 0)


def test_a_mass_that_is_not_known_is_not_said() -> None:
    team = make_team(seed=8)
    estimate = estimate_of(team)
    theta = estimate.body.unknowns.theta
    hidden = estimate.hidden.copy()
    hidden[theta.start, theta.start] = 100.0
    claim = claim_of(replace(estimate, hidden=hidden), 0)
    assert claim.inertia is None
    assert claim.known == 0
    assert any(words.startswith("mass") for words in claim.unobservable)


@pytest.mark.parametrize("robot", [0, 1])
def test_only_bodies_that_exist_are_claimed(robot: int) -> None:
    team = make_team(seed=9, number=200)
    estimate = estimate_of(team)
    load = team.load.copy()
    inertia = Inertia.from_barycentric(load[6:])
    thin = Inertia(inertia.mass, inertia.com, np.diag([1.0, 1.0, 2.01]))  # the triangle inequality is broken
    load[6:] = thin.barycentric()
    assert not is_possible(load[6:])
    body = IDEAL.body(estimate.state.with_load(load))
    claim = claim_of(replace(estimate, body=body), robot)
    assert claim.inertia is not None
    assert (np.linalg.eigvalsh(pseudo_inertia(claim.inertia.barycentric())) > -1e-9).all()
    # The likeliest one: nearer than a body that is the nearest by its numbers.
    theta = estimate.body.unknowns.theta
    information = np.linalg.inv(estimate.covariance[theta, theta])
    found = claim.inertia.transported(estimate.state.poses[robot]).barycentric() - load[6:]
    other = nearest_possible(load[6:], np.eye(10), estimate.guess.size) - load[6:]
    assert found @ information @ found < 0.99 * (other @ information @ other)


def test_all_robots_claim_the_same_body() -> None:
    team = make_team(seed=10, number=200)
    estimate = estimate_of(team)
    bodies = [claim_of(estimate, robot).inertia for robot in range(3)]
    carried = [
        central(None if body is None else body.transported(pose))
        for body, pose in zip(bodies, estimate.state.poses, strict=True)
    ]
    np.testing.assert_allclose(carried[1:], [carried[0]] * 2, atol=1e-9)
