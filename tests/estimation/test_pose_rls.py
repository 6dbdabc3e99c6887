"""The dual-quaternion filter: exact on exact data, recursive, and honest about its errors."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import chdtri

from coheft.estimation.fan2017.pose_rls import PoseRls
from coheft.estimation.geometry.body_motion import perturbation_between, perturbed
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.geometry.uncertain_pose import UncertainPose
from coheft.estimation.measurement import SensorNoise
from tests.estimation.team import Team, make_team
from tests.rigid_motions import poses, vectors

NOISE = SensorNoise()
EXACT = NOISE.scaled(1e-6)
"""What the filter has to be told about exact data: nominal noise, taken out of exact data, would mislead it."""


class EquallyWeighted(PoseRls):
    """Its weight does not follow the estimate, so block and sample recursions are the same sums."""

    def _translation_noise(self) -> Array:
        return 1e-4 * np.eye(4)


def true_pose(team: Team) -> Pose:
    return team.poses[0].inverse() @ team.poses[1]


def fed(pose_filter: PoseRls, samples: Array, block: int) -> UncertainPose:
    """The filter's estimate of ``pose_2_in_1`` after samples (n, N, 15) in blocks."""
    for start in range(0, len(samples), block):
        twists = samples[start : start + block, :, :6]
        pose_filter.update(twists[:, 0], twists[:, 1])
    return pose_filter.estimate


@settings(max_examples=15)
@given(st.integers(0, 10**6), st.sampled_from([0.99, 1.0]))
def test_exact_data_give_the_exact_pose(seed: int, forgetting: float) -> None:
    team = make_team(seed, count=2, duration=3.0)
    estimate = fed(PoseRls(EXACT, forgetting), team.exact, block=10)
    assert np.abs(perturbation_between(true_pose(team), estimate.pose)).max() < 1e-9


@pytest.mark.parametrize("forgetting", [0.98, 1.0])
def test_blocks_are_the_recursion_sample_by_sample(forgetting: float) -> None:
    team = make_team(7, count=2, duration=2.0)
    samples = team.measured(np.random.default_rng(8))
    by_block = fed(EquallyWeighted(NOISE, forgetting), samples, block=20)
    by_sample = fed(EquallyWeighted(NOISE, forgetting), samples, block=1)
    np.testing.assert_allclose(perturbation_between(by_sample.pose, by_block.pose), 0.0, atol=1e-9)
    np.testing.assert_allclose(by_block.covariance, by_sample.covariance, rtol=1e-6)


def test_forgetting_follows_a_grasp_that_slipped() -> None:
    before, after = make_team(1, count=2, duration=2.0), make_team(2, count=2, duration=2.0)
    samples = np.concatenate([before.exact, after.exact])
    errors = [
        np.abs(perturbation_between(true_pose(after), fed(PoseRls(EXACT, forgetting), samples, 10).pose)).max()
        for forgetting in (0.9, 0.95, 1.0)
    ]
    assert errors[0] < 1e-6 < 1e-1 < errors[2]
    assert errors[0] < errors[1] < 1e-2


@given(poses, vectors(1.0, 6), vectors(1e-5, 6))
def test_inverse_carries_the_covariance(pose: Pose, axis: Array, error: Array) -> None:
    estimate = UncertainPose(pose, np.outer(axis, axis))
    back = estimate.inverse().inverse()
    np.testing.assert_allclose(perturbation_between(pose, back.pose), 0.0, atol=1e-12)
    np.testing.assert_allclose(back.covariance, estimate.covariance, atol=1e-12)
    # Of a small error, to first order.
    truth = perturbed(pose, error)
    certain = UncertainPose(pose, np.outer(error, error)).inverse()
    inverse_error = perturbation_between(pose.inverse(), truth.inverse())
    np.testing.assert_allclose(certain.covariance, np.outer(inverse_error, inverse_error), atol=1e-13)


def test_before_the_first_sample_it_knows_nothing() -> None:
    estimate = PoseRls(NOISE).estimate
    np.testing.assert_array_equal(estimate.pose.rotation, np.eye(3))
    assert estimate.rotation_std > 1.0
    assert estimate.translation_std > 1.0


@pytest.mark.slow
def test_errors_are_as_large_as_the_covariance_says() -> None:
    """Normalised squared errors over 60 motions and grasps lie in the chi-square interval, up to 15 %."""
    noise, runs = NOISE.scaled(10.0), 60
    squares = np.empty((runs, 2))
    for run in range(runs):
        team = make_team(run, count=2, duration=8.0, noise=noise)
        estimate = fed(PoseRls(noise), team.measured(np.random.default_rng(1000 + run)), block=20)
        error = perturbation_between(estimate.pose, true_pose(team))
        squares[run] = (
            error[:3] @ np.linalg.solve(estimate.covariance[:3, :3], error[:3]),
            error @ np.linalg.solve(estimate.covariance, error),
        )
    for mean, size in zip(squares.mean(axis=0), (3, 6), strict=True):
        low, high = chdtri(size * runs, [0.999, 0.001]) / runs
        assert low / 1.15 < mean < 1.15 * high


@pytest.mark.slow
def test_no_bias_from_noise_in_the_regressor() -> None:
    """At twenty times the noise, least squares would shrink the translation by several percent."""
    rng = np.random.default_rng(3)
    noise = NOISE.scaled(20.0)
    shares = []
    for run in range(30):
        team = make_team(run, count=2, duration=20.0, noise=noise)
        p = true_pose(team).translation
        shares.append(fed(PoseRls(noise), team.measured(rng), block=20).pose.translation @ p / (p @ p))
    assert abs(np.mean(shares) - 1.0) < 4.0 * np.std(shares) / np.sqrt(len(shares))


def test_rotation_about_one_axis_leaves_a_translation_unknown() -> None:
    team = make_team(4, count=2, duration=8.0, single_axis=True)
    estimate = fed(PoseRls(NOISE), team.measured(np.random.default_rng(5)), block=20)
    assert estimate.translation_std > 0.1
    assert np.linalg.eigvalsh(estimate.covariance)[0] > 0.0
