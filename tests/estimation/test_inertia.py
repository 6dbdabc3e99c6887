"""The linear model of inertia: exact without noise, unbiased, at the bound and honest; and what it cannot see."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from coheft.estimation.bounds import wrench_derivative, wrench_regressor
from coheft.estimation.consistency import parameters_of
from coheft.estimation.inertia import (
    InertiaInformation,
    InertiaModel,
    features,
    packed_gram,
    products_wrench,
    spatial_inertia,
    symmetric_products,
)
from coheft.estimation.inertia_estimate import InertiaEstimate, middle_and_size, solve_inertia
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.rigid_body import pseudo_inertia
from coheft.estimation.spatial import Array
from tests.estimation.fusion import fused_features, fusion_of
from tests.estimation.team import Team, make_team

LENGTH = 0.5
CENTRE = np.zeros(3)


def true_wrench(team: Team) -> Array:
    return team.inertia.wrench(team.motion[:, 0:3], team.motion[:, 6:9], team.motion[:, 9:12])


def information_of(team: Team, sample_features: Array, with_offset: bool = False) -> InertiaInformation:
    """With the weights of the second iteration."""
    fusion, gram = fusion_of(team), packed_gram(sample_features)
    parameters = None
    for _ in range(2):
        model = InertiaModel(fusion.wrench_covariance, fusion.acceleration_covariance, parameters, with_offset)
        information = model.information(gram)
        parameters = np.linalg.solve(information.matrix, information.vector)[:10]
    return information


def estimate_inertia(information: InertiaInformation, centre: Array, length: float) -> InertiaEstimate:
    return solve_inertia(information, centre, length).made_possible()


def estimate_of(team: Team, sample_features: Array, with_offset: bool = False) -> InertiaEstimate:
    return estimate_inertia(information_of(team, sample_features, with_offset), CENTRE, LENGTH)


def bound_of(team: Team) -> Array:
    """Covariance bound (10, 10) of theta with known poses, the body's motion eliminated sample by sample."""
    fusion = fusion_of(team)
    by_motion = wrench_derivative(team.inertia, team.motion)
    motion_covariance = np.zeros((12, 12))
    motion_covariance[6:, 6:] = fusion.acceleration_covariance
    order = np.r_[3:6, 0:3]
    motion_covariance[np.ix_(order, order)] = fusion.velocity_covariance
    covariance = fusion.wrench_covariance + by_motion @ motion_covariance @ by_motion.transpose(0, 2, 1)
    regressor = wrench_regressor(team.motion)
    return np.linalg.inv(np.sum(regressor.transpose(0, 2, 1) @ np.linalg.solve(covariance, regressor), axis=0))


def test_exact_samples_give_the_exact_inertia() -> None:
    team = make_team(seed=1, duration=3.0)
    sample_features = features(team.motion, true_wrench(team))
    rng = np.random.default_rng(1)
    weights = rng.normal(size=(6, 6))
    model = InertiaModel(weights @ weights.T, np.zeros((6, 6)), rng.normal(size=10))
    information = model.information(packed_gram(sample_features))
    theta = np.linalg.solve(information.matrix, information.vector)
    np.testing.assert_allclose(theta, team.inertia.barycentric(), atol=1e-8)
    assert abs(information.mean_square(theta)) < 1e-6


def test_information_is_that_of_the_weighted_regressor() -> None:
    team = make_team(seed=2, duration=1.0)
    fusion, theta = fusion_of(team), team.inertia.barycentric()
    model = InertiaModel(fusion.wrench_covariance, fusion.acceleration_covariance, theta)
    wrench = true_wrench(team)
    information = model.information(packed_gram(features(team.motion, wrench)))
    spatial = spatial_inertia(theta)
    covariance = fusion.wrench_covariance + spatial @ fusion.acceleration_covariance @ spatial.T
    regressor = wrench_regressor(team.motion)
    weighted = np.linalg.solve(covariance, regressor)
    expected = np.sum(regressor.transpose(0, 2, 1) @ weighted, axis=0)
    np.testing.assert_allclose(information.uncompensated, expected, rtol=1e-8, atol=1e-8 * expected.max())
    vector = np.einsum("nij,ni->j", weighted, wrench)
    np.testing.assert_allclose(information.vector, vector, rtol=1e-8, atol=1e-8 * np.abs(vector).max())


def test_a_disturbance_adds_to_scores_what_weighted_regressors_make_of_its_covariance() -> None:
    team = make_team(seed=2, duration=1.0)
    fusion, theta = fusion_of(team), team.inertia.barycentric()
    model = InertiaModel(fusion.wrench_covariance, fusion.acceleration_covariance, theta)
    root = np.random.default_rng(5).normal(size=(6, 6))
    model.expect_disturbance(root @ root.T)
    added = model.disturbance(packed_gram(features(team.motion, true_wrench(team))))
    spatial = spatial_inertia(theta)
    covariance = fusion.wrench_covariance + spatial @ fusion.acceleration_covariance @ spatial.T
    by_root = wrench_regressor(team.motion).transpose(0, 2, 1) @ np.linalg.solve(covariance, root)
    expected = np.sum(by_root @ by_root.transpose(0, 2, 1), axis=0)
    np.testing.assert_allclose(added, expected, rtol=1e-8, atol=1e-8 * expected.max())


def test_products_of_w_make_the_wrench_of_turning() -> None:
    team = make_team(seed=3, duration=0.1)
    w, zero = team.motion[:, :3], np.zeros((len(team.motion), 3))
    wrench = symmetric_products(w) @ products_wrench(spatial_inertia(team.inertia.barycentric()))
    np.testing.assert_allclose(wrench, team.inertia.wrench(w, zero, zero), atol=1e-12)


@pytest.mark.parametrize("scale", [1.0, 3.0])
def test_errors_reach_the_bound_and_are_what_the_covariance_says(scale: float) -> None:
    seeds = range(24)
    by_bound = by_own = squares = 0.0
    for seed in seeds:
        team = make_team(seed, duration=8.0, noise=SensorNoise().scaled(scale))
        information = information_of(team, fused_features(team, team.measured(np.random.default_rng(seed))))
        estimate = estimate_inertia(information, CENTRE, LENGTH)
        error = estimate.parameters - team.inertia.barycentric()
        by_bound += error @ np.linalg.solve(bound_of(team), error)
        by_own += error @ np.linalg.solve(estimate.parameters_covariance, error)
        squares += information.mean_square(estimate.parameters)
        assert not estimate.unseen
    low, high = chi2.ppf([0.001, 0.999], 10 * len(seeds))
    assert low < by_own < high
    assert by_bound < high
    assert squares / len(seeds) == pytest.approx(1.0, abs=0.03)


def test_noise_of_the_regressor_leaves_no_bias() -> None:
    noise = SensorNoise(gyro=0.02, acceleration=0.5, force=0.05, torque=0.01)
    errors, biased, covariance = [], [], np.zeros((10, 10))
    for seed in range(12):
        team = make_team(7, duration=10.0, noise=noise)
        information = information_of(team, fused_features(team, team.measured(np.random.default_rng(seed))))
        estimate = estimate_inertia(information, CENTRE, LENGTH)
        errors.append(estimate.parameters - team.inertia.barycentric())
        biased.append(np.linalg.solve(information.uncompensated, information.vector) - team.inertia.barycentric())
        covariance += estimate.parameters_covariance
    of_mean = covariance / len(errors) ** 2
    limit = chi2.ppf(0.999, 10)
    assert np.mean(errors, axis=0) @ np.linalg.solve(of_mean, np.mean(errors, axis=0)) < limit
    assert np.mean(biased, axis=0) @ np.linalg.solve(of_mean, np.mean(biased, axis=0)) > 10.0 * limit


def test_constant_offset_is_told_from_the_load() -> None:
    team = make_team(seed=8, duration=20.0)
    offset = np.array([4.0, -3.0, 2.0, 0.2, 0.3, -0.4])
    sample_features = fused_features(team, team.measured(np.random.default_rng(8)))
    sample_features[:, -6:] += offset
    estimate = estimate_of(team, sample_features, with_offset=True)
    assert estimate.offset is not None
    np.testing.assert_allclose(estimate.offset, offset, atol=0.15)
    error = estimate.parameters - team.inertia.barycentric()
    assert error @ np.linalg.solve(estimate.parameters_covariance, error) < chi2.ppf(0.999, 10)
    assert abs(estimate_of(team, sample_features).inertia.mass - team.inertia.mass) > 20.0 * np.sqrt(
        estimate.covariance[0, 0]
    )


def test_covariance_of_mass_com_and_inertia_follows_from_that_of_the_parameters() -> None:
    team = make_team(seed=9, duration=5.0)
    estimate = estimate_of(team, fused_features(team, team.measured(np.random.default_rng(9))))
    of_mass, of_moment = estimate.parameters_covariance[0, 0], estimate.parameters_covariance[1:4, 0]
    assert estimate.covariance[0, 0] == pytest.approx(of_mass)
    expected = (of_moment - estimate.inertia.com * of_mass) / estimate.inertia.mass
    np.testing.assert_allclose(estimate.covariance[1:4, 0], expected, rtol=1e-6, atol=1e-12)


def test_turning_about_one_axis_hides_the_inertia_about_the_others() -> None:
    team = make_team(seed=10, single_axis=True)
    estimate = estimate_of(team, fused_features(team, team.measured(np.random.default_rng(10))))
    axis = np.linalg.svd(team.motion[:, :3])[2][0]
    hidden = [unseen.what.removeprefix("inertia about ") for unseen in estimate.unseen]
    assert len(hidden) == 2
    for name in hidden:
        direction = np.array([float(x) for x in name.strip("()").split(", ")])
        assert abs(direction @ axis) < 0.05
    assert abs(estimate.inertia.mass - team.inertia.mass) < 5.0 * np.sqrt(estimate.covariance[0, 0])
    about_axis = axis @ (estimate.inertia.tensor - team.inertia.tensor) @ axis
    assert abs(about_axis) < 0.1


def test_at_rest_only_the_mass_and_two_coordinates_of_the_com_are_seen() -> None:
    team = make_team(seed=11)
    gravity = team.motion[0, 6:9]
    rest = np.zeros_like(team.motion)
    rest[:, 6:9] = gravity
    rng = np.random.default_rng(11)
    fusion = fusion_of(team)
    wrench = team.inertia.wrench(rest[:, :3], rest[:, 6:9], rest[:, 9:])
    rest[:, 6:] += rng.multivariate_normal(np.zeros(6), fusion.acceleration_covariance, len(rest))
    wrench += rng.multivariate_normal(np.zeros(6), fusion.wrench_covariance, len(rest))
    estimate = estimate_of(team, features(rest, wrench))
    com, inertia = (unseen.what for unseen in estimate.unseen)
    assert inertia == "inertia"
    direction = np.array([float(x) for x in com.removeprefix("centre of mass along ").strip("()").split(", ")])
    assert abs(direction @ gravity) / np.linalg.norm(gravity) > 0.99
    assert abs(estimate.inertia.mass - team.inertia.mass) < 5.0 * np.sqrt(estimate.covariance[0, 0])


def test_without_samples_nothing_is_seen_and_the_guess_is_a_body() -> None:
    model = InertiaModel(np.eye(6), np.eye(6))
    estimate = estimate_inertia(model.information(np.zeros(190)), np.array([0.1, 0.0, 0.0]), LENGTH)
    assert [unseen.what for unseen in estimate.unseen] == ["mass", "centre of mass", "inertia"]
    np.testing.assert_allclose(estimate.inertia.com, [0.1, 0.0, 0.0], atol=1e-9)


def seen_from(information: InertiaInformation, origin: Array) -> InertiaInformation:
    """The same about the inertia as it is seen from another origin (3,), axes alike."""
    shift = np.eye(4)
    shift[:3, 3] = origin
    to_old = np.column_stack([parameters_of(shift @ pseudo_inertia(column) @ shift.T) for column in np.eye(10)])
    return replace(
        information,
        matrix=to_old.T @ information.matrix @ to_old,
        vector=to_old.T @ information.vector,
        score_covariance=to_old.T @ information.score_covariance @ to_old,
        uncompensated=to_old.T @ information.uncompensated @ to_old,
    )


@pytest.mark.parametrize("seed", range(5))
def test_the_guess_does_not_draw_what_is_seen_however_far_away_the_origin_is(seed: int) -> None:
    team = make_team(seed, duration=1.5)
    centre, length = middle_and_size(team.poses)
    information = information_of(team, fused_features(team, team.measured(np.random.default_rng(seed))))
    for origin in ([0.0, 0.0, 0.0], [1.0, -1.0, 0.5]):
        seen = seen_from(information, np.array(origin))
        estimate = estimate_inertia(seen, centre - origin, length)
        least_squares = np.linalg.solve(seen.matrix, seen.vector)
        deviations = np.sqrt(np.diag(np.linalg.inv(seen.matrix)))
        assert np.all(np.abs(estimate.parameters - least_squares) < 0.1 * deviations)
