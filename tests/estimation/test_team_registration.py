"""Poses of the whole team: bound, honesty, recursion without summing again, what cannot be seen."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import pytest
from scipy.stats import chi2

from coheft.estimation.body_motion import BODY_W, perturbation_between, perturbed
from coheft.estimation.bounds import joint_bound
from coheft.estimation.inertia import symmetric_products
from coheft.estimation.measurement import KINEMATICS, SensorNoise
from coheft.estimation.motion_fusion import (
    MotionFusion,
    carried_constants,
    derivative_kernel,
    robot_constants,
    summands,
)
from coheft.estimation.observability import Visibility, all_seen, seen_information
from coheft.estimation.registration import RegistrationMoments, score_and_information
from coheft.estimation.spatial import Array, Pose
from coheft.estimation.team_registration import (
    TeamPoses,
    refit_map,
    register_team,
    residual_shares,
    team_information,
)
from coheft.estimation.twist_registration import TwistMoments, register_twists
from tests.estimation.team import Team, make_team

NOISE = SensorNoise()
KERNEL = derivative_kernel(3, 0.01)


def fused_motion(samples: Array, poses: Sequence[Pose], noise: SensorNoise) -> Array:
    """What the network's sums make of the samples (n, N, 15), in the body frame: shape (n, 12)."""
    sums = sum(summands(samples[:, i], noise) @ pose.adjoint().T for i, pose in enumerate(poses))
    constants = sum(carried_constants(robot_constants(noise), pose) for pose in poses)
    return MotionFusion.of(np.asarray(constants), KERNEL).motion(np.asarray(sums))


def all_moments(samples: Array, motion: Array) -> list[RegistrationMoments]:
    return [RegistrationMoments.of(samples[:, i, KINEMATICS], motion) for i in range(samples.shape[1])]


def joint_step(
    moments: Sequence[RegistrationMoments], poses: Sequence[Pose], noise: SensorNoise, limits: Visibility | None = None
) -> TeamPoses:
    scores = [score_and_information(own, pose, noise)[0] for own, pose in zip(moments, poses, strict=True)]
    return register_team(poses, np.array(scores), moments[0], noise, limits)


def chained(samples: Array, noise: SensorNoise) -> list[Pose]:
    """Start: poses of neighbouring pairs, chained away from the reference."""
    poses = [Pose.identity()]
    for i in range(samples.shape[1] - 1):
        moments = TwistMoments.of(samples[:, i, :6], samples[:, i + 1, :6])
        poses.append(poses[-1] @ register_twists(moments, noise, noise).pose)
    return poses


def recursive(samples: Array, noise: SensorNoise, first: int = 200, every: int = 100) -> TeamPoses:
    """As agents do it: every sample is summed once, with the poses of its time."""
    poses: Sequence[Pose] = chained(samples[:first], noise)
    moments = [RegistrationMoments.none()] * samples.shape[1]
    for start in range(0, len(samples), every):
        block = samples[start : start + every]
        new = all_moments(block, fused_motion(block, poses, noise))
        moments = [old + add for old, add in zip(moments, new, strict=True)]
        if start + every >= first:
            team_poses = joint_step(moments, poses, noise)
            feature_map = refit_map(poses, team_poses.poses, noise)
            moments = [own.mapped(feature_map) for own in moments]
            poses = team_poses.poses
    return team_poses


def in_one_go(samples: Array, start: Sequence[Pose], noise: SensorNoise, steps: int = 3) -> TeamPoses:
    """All samples summed again after every step: the maximum-likelihood estimate."""
    poses = start
    for _ in range(steps):
        team_poses = joint_step(all_moments(samples, fused_motion(samples, poses, noise)), poses, noise)
        poses = team_poses.poses
    return team_poses


def errors(team: Team, poses: Sequence[Pose]) -> Array:
    pairs = zip(team.poses[1:], poses[1:], strict=True)
    return np.concatenate([perturbation_between(true, estimate) for true, estimate in pairs])


def test_information_is_that_of_the_joint_bound() -> None:
    team = make_team(1)
    moments = RegistrationMoments.of(team.exact[:, 1, KINEMATICS], team.motion)
    information, from_noise = team_information(moments, team.poses, NOISE)
    bound = joint_bound(
        team.poses, team.inertia, team.motion, team.exact[:, :, 9:], NOISE, wrench_from=len(team.motion)
    )
    product = information[6:, 6:] @ bound.covariance[6:36, 6:36]
    values = np.linalg.eigvals(product).real
    # Noise of w in centripetal accelerations is left out: 4 % of the information in the worst of 30 directions.
    assert 0.95 < values.min() < values.max() < 1.05
    np.testing.assert_allclose(np.mean(values), 1.0, atol=0.01)
    assert np.trace(from_noise) < 1e-3 * np.trace(information)


def test_noise_in_the_information_is_what_it_is_said_to_be() -> None:
    team = make_team(1, noise=NOISE.scaled(10.0))
    exact, _ = team_information(all_moments(team.exact, team.motion)[0], team.poses, team.noise)
    half = np.linalg.inv(np.linalg.cholesky(exact[6:, 6:]))
    excess = []
    for seed in range(40):
        motion = fused_motion(team.measured(np.random.default_rng(seed)), team.poses, team.noise)
        noisy, from_noise = team_information(all_moments(team.exact, motion)[0], team.poses, team.noise)
        excess.append(np.trace(half @ (noisy - exact)[6:, 6:] @ half.T))
    said = np.trace(half @ from_noise[6:, 6:] @ half.T)
    assert said > 0.1
    assert abs(np.mean(excess) - said) < 0.1 * said


@pytest.mark.parametrize("count", [3, 6])
def test_residuals_are_as_large_as_what_noise_leaves_in_them(count: int) -> None:
    team = make_team(seed=2, count=count, duration=20.0)
    samples = team.measured(np.random.default_rng(3))
    shares = residual_shares(team.poses, team.noise)
    assert 9.0 * (count - shares.sum()) < 12.0 + 1e-9, "the motion in the sums has 12 numbers"
    for pose, share, moments in zip(
        team.poses, shares, all_moments(samples, fused_motion(samples, team.poses, team.noise)), strict=True
    ):
        _, _, cost = score_and_information(moments, pose, team.noise)
        square = 2.0 * cost / (9.0 * moments.count)
        by_chance = np.sqrt(2.0 * share / (9.0 * moments.count))
        assert abs(square - share) < 5.0 * by_chance


def test_refit_map_does_what_summing_again_would_do() -> None:
    team = make_team(2, duration=5.0)
    rng = np.random.default_rng(0)
    samples = team.measured(rng)
    old = [team.poses[0], *(perturbed(pose, 0.003 * rng.normal(size=6)) for pose in team.poses[1:])]

    def features(poses: Sequence[Pose]) -> Array:
        motion = fused_motion(samples, poses, team.noise)
        rest = np.zeros((len(motion), 10))
        return np.hstack([rest, motion, symmetric_products(motion[:, BODY_W])])

    before, after = features(old), features(team.poses)
    mapped = before @ refit_map(old, team.poses, team.noise).T
    for part in (slice(10, 13), slice(13, 16), slice(16, 19), slice(19, 22), slice(22, 28)):
        left, moved = (np.linalg.norm((other - after)[:, part]) for other in (mapped, before))
        assert left < 0.1 * moved
    np.testing.assert_allclose(refit_map(old, old, team.noise), np.eye(28), atol=1e-7)


def test_recursion_reaches_the_bound_and_knows_it() -> None:
    runs, noise = 30, NOISE.scaled(3.0)
    nees, ratios, distance = 0.0, [], []
    for seed in range(runs):
        team = make_team(seed, noise=noise)
        samples = team.measured(np.random.default_rng([seed, 1]))
        estimate = recursive(samples, noise, every=200)
        error = errors(team, estimate.poses)
        nees += error @ np.linalg.solve(estimate.covariance[6:, 6:], error)
        bound = joint_bound(
            team.poses, team.inertia, team.motion, team.exact[:, :, 9:], noise, wrench_from=len(team.motion)
        )
        ratios.append(error**2 / np.diag(bound.covariance)[6:36])
        if seed < 3:
            best = in_one_go(samples, estimate.poses, noise)
            apart = errors(team, estimate.poses) - errors(team, best.poses)
            distance.append(apart / np.sqrt(np.diag(best.covariance)[6:]))
    low, high = chi2.ppf([1e-4, 1 - 1e-4], 30 * runs)
    assert low < nees < high
    rotation, translation = np.mean(np.reshape(ratios, (runs, 5, 2, 3)), axis=(0, 1, 3))
    assert np.sqrt(rotation) < 1.15
    assert np.sqrt(translation) < 1.15
    assert np.abs(distance).max() < 0.1


def test_relative_poses_close_all_loops_and_carry_the_bound() -> None:
    team = make_team(4)
    estimate = recursive(team.measured(np.random.default_rng(0)), NOISE)
    around = Pose.identity()
    for i in range(6):
        around = around @ estimate.relative(i, (i + 1) % 6).pose
    assert np.abs(around.log()).max() < 1e-12
    bound = joint_bound(
        team.poses, team.inertia, team.motion, team.exact[:, :, 9:], NOISE, wrench_from=len(team.motion)
    )
    for i, j in itertools.permutations(range(6), 2):
        claimed = np.sqrt(np.diag(estimate.relative(i, j).covariance))
        np.testing.assert_allclose(claimed, np.sqrt(np.diag(bound.relative_pose(i, j))), rtol=0.05)


def test_gyro_offsets_do_not_matter() -> None:
    team = make_team(5)
    samples = team.measured(np.random.default_rng(0))
    with_offsets = samples.copy()
    with_offsets[:, :, :3] += np.random.default_rng(1).uniform(-0.01, 0.01, (6, 3))
    clean, shifted = (recursive(data, NOISE) for data in (samples, with_offsets))
    apart = errors(team, shifted.poses) - errors(team, clean.poses)
    assert np.all(np.abs(apart) < 0.35 * np.sqrt(np.diag(clean.covariance)[6:]))


def test_single_axis_hides_every_translation_along_it() -> None:
    team = make_team(3, single_axis=True)
    motion = fused_motion(team.measured(np.random.default_rng(0)), team.poses, NOISE)
    moments = all_moments(team.measured(np.random.default_rng(0)), motion)
    estimate = joint_step(moments, team.poses, NOISE)
    w = team.motion[np.argmax(np.linalg.norm(team.motion[:, BODY_W], axis=1)), BODY_W]
    axis = team.poses[2].rotation.T @ w / np.linalg.norm(w)
    (unseen,) = estimate.relative(2, 4).unseen
    assert abs(unseen.translation @ axis) > 0.999
    assert np.abs(errors(team, estimate.poses)).max() < 0.01


def test_a_large_team_is_fitted_as_a_small_one_would_be() -> None:
    """Of many poses the unseen directions are not looked for; the result is the same."""
    team = make_team(5, count=70, duration=2.0)
    samples = team.measured(np.random.default_rng(5))
    moments = all_moments(samples, fused_motion(samples, team.poses, NOISE))
    scores = np.array([score_and_information(m, p, NOISE)[0] for m, p in zip(moments, team.poses, strict=True)])
    found = register_team(team.poses, scores, moments[0], NOISE)
    information, from_noise = team_information(moments[0], team.poses, NOISE)
    seen = seen_information((information - from_noise)[6:, 6:], Visibility())
    assert seen.unseen_count == 0
    np.testing.assert_allclose(found.covariance[6:, 6:], seen.inverse(), atol=1e-9 * np.abs(seen.inverse()).max())
    steps = seen.step(scores[1:].ravel()).reshape(-1, 6)
    for old, new, step in zip(team.poses[1:], found.poses[1:], steps, strict=True):
        np.testing.assert_allclose(perturbation_between(old, new), step, atol=1e-9)


def test_what_a_large_team_has_not_seen_is_still_found() -> None:
    information = np.eye(12) * 1e6
    information[7, 7] = 0.0
    assert all_seen(information, Visibility(), np.zeros((12, 12))) is None
