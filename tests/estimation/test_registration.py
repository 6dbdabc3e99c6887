"""Own-pose registration: features, derivatives, exactness, offsets."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.estimation.body_motion import BODY_W, grasp_measurements, perturbation_between, perturbed
from coheft.estimation.inertia import symmetric_products
from coheft.estimation.measurement import KINEMATICS, SensorNoise
from coheft.estimation.registration import (
    RegistrationMoments,
    least_squares,
    residual_derivative,
    residual_operator,
    score_and_information,
)
from coheft.estimation.spatial import Array, Pose
from tests.estimation.team import make_team, random_pose

NOISE = SensorNoise()
STEP = 1e-6


def test_residuals_are_linear_in_the_features() -> None:
    rng = np.random.default_rng(0)
    pose, own, motion = random_pose(rng), rng.normal(size=(7, 9)), rng.normal(size=(7, 12))
    features = np.hstack([np.ones((7, 1)), own, motion, symmetric_products(motion[:, BODY_W])])
    np.testing.assert_allclose(features @ residual_operator(pose).T, own - grasp_measurements(pose, motion), atol=1e-12)


def test_residual_derivative() -> None:
    pose = random_pose(np.random.default_rng(1))
    for analytic, e in zip(residual_derivative(pose), np.eye(6), strict=True):
        ahead, behind = (residual_operator(perturbed(pose, step * e)) for step in (STEP, -STEP))
        np.testing.assert_allclose(analytic, (ahead - behind) / (2 * STEP), atol=1e-9)


def test_score_is_the_gradient_and_information_the_curvature() -> None:
    team = make_team(1, duration=3.0)
    own = team.measured(np.random.default_rng(0))[:, 2, KINEMATICS]
    pose = perturbed(team.poses[2], 0.1 * np.ones(6))
    moments = RegistrationMoments.of(own, team.motion)

    score, _, _ = score_and_information(moments, pose, NOISE)
    for value, e in zip(score, np.eye(6), strict=True):
        ahead, behind = (score_and_information(moments, perturbed(pose, s * e), NOISE)[2] for s in (STEP, -STEP))
        assert -(ahead - behind) / (2 * STEP) == pytest.approx(value, rel=1e-5)

    exact = RegistrationMoments.of(team.exact[:, 2, KINEMATICS], team.motion)
    _, information, cost = score_and_information(exact, team.poses[2], NOISE)
    assert abs(cost) < 1e-3
    for row, e in zip(information, np.eye(6), strict=True):
        moved = (perturbed(team.poses[2], s * e) for s in (STEP, -STEP))
        ahead, behind = (score_and_information(exact, pose, NOISE)[0] for pose in moved)
        np.testing.assert_allclose(-(ahead - behind) / (2 * STEP), row, atol=1e-4 * np.abs(information).max())


def test_least_squares_are_those_at_the_best_pose_and_show_a_sensor_that_was_off_for_a_while() -> None:
    team = make_team(1, duration=5.0)
    own = team.measured(np.random.default_rng(0))[:, 2, KINEMATICS]
    nearby = perturbed(team.poses[2], np.r_[0.01 * np.ones(3), 0.01 * np.ones(3)])

    def mean_square(samples: Array, pose: Pose) -> float:
        moments = RegistrationMoments.of(samples, team.motion)
        return least_squares(*score_and_information(moments, pose, NOISE)) / (9.0 * moments.count)

    usual = mean_square(own, team.poses[2])
    assert usual == pytest.approx(1.0, abs=8.0 * np.sqrt(2.0 / own.size))
    assert mean_square(own, nearby) == pytest.approx(usual, rel=0.02)
    own[:, 3:6] += 5.0 * NOISE.velocity  # all the time: it is found along with the pose
    assert mean_square(own, team.poses[2]) == pytest.approx(usual, rel=1e-6)
    own[:200, 3:6] -= 5.0 * NOISE.velocity
    assert mean_square(own, team.poses[2]) > 2.0


def test_exact_data_give_the_exact_pose_in_blocks_and_with_offsets() -> None:
    team = make_team(2, duration=5.0)
    offset = np.r_[0.1 * np.ones(6), np.zeros(3)]
    own = team.exact[:, 3, KINEMATICS] + offset
    moments = RegistrationMoments.none()
    for block in range(0, 500, 50):
        rows = slice(block, block + 50)
        moments = moments + RegistrationMoments.of(own[rows], team.motion[rows])
    assert moments.count == 500
    pose = perturbed(team.poses[3], 0.1 * np.ones(6))
    for _ in range(6):
        score, information, _ = score_and_information(moments, pose, NOISE)
        pose = perturbed(pose, np.linalg.solve(information, score))
    assert np.abs(perturbation_between(team.poses[3], pose)).max() < 1e-8


def test_single_axis_hides_the_translation_along_it() -> None:
    team = make_team(3, duration=10.0, single_axis=True)
    moments = RegistrationMoments.of(team.exact[:, 3, KINEMATICS], team.motion)
    _, information, _ = score_and_information(moments, team.poses[3], NOISE)
    values, directions = np.linalg.eigh(information)
    assert values[0] < 1e-6 * values[1]
    axis = team.motion[np.argmax(np.linalg.norm(team.motion[:, BODY_W], axis=1)), BODY_W]
    assert abs(directions[3:, 0] @ axis) / np.linalg.norm(axis) > 0.9999


def test_shapes_are_checked() -> None:
    with pytest.raises(ValueError, match=r"expected \(n, 9\) and \(n, 12\)"):
        RegistrationMoments.of(np.zeros((5, 9)), np.zeros((5, 9)))
