"""What a former team knew of its poses: passed on as independent errors, and put together with what is new."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from coheft.estimation.body_motion import perturbation_between, perturbed
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.observability import Visibility
from coheft.estimation.registration import RegistrationMoments, score_and_information
from coheft.estimation.spatial import Array, Pose
from coheft.estimation.team_registration import NO_SLOPE, PosePrior, TeamPoses, fitted_poses, register_team
from tests.estimation.team import Team, make_team, random_pose
from tests.estimation.test_team_registration import all_moments, errors, fused_motion

NOISE = SensorNoise()
ROBOTS = 4
DEVIATIONS = np.vstack([np.zeros(6), np.tile([1e-3] * 3 + [2e-3] * 3, (ROBOTS - 1, 1))])


def random_covariance(rng: np.random.Generator) -> Array:
    root = rng.normal(size=(6 * ROBOTS, 40)) * 10.0 ** rng.uniform(-4.0, 0.0, 40)
    root[:6] = 0.0
    result: Array = root @ root.T
    return result


def random_poses(rng: np.random.Generator) -> tuple[Pose, ...]:
    return tuple(random_pose(rng) for _ in range(ROBOTS))


@given(st.integers(0, 2**32 - 1))
def test_no_error_is_likelier_than_its_bounds_say(seed: int) -> None:
    rng = np.random.default_rng(seed)
    team = TeamPoses(random_poses(rng), random_covariance(rng), Visibility())
    bounds = team.bounds
    assert np.array_equal(bounds[0], np.zeros(6))
    left = np.diag(bounds[1:].ravel() ** 2) - team.covariance[6:, 6:]
    scale = bounds[1:].ravel()
    assert np.linalg.eigvalsh(left / scale[:, None] / scale)[0] > -1e-9
    # Passed on once more, they do not grow.
    again = TeamPoses.known_within(team.poses, bounds)
    np.testing.assert_allclose(again.bounds, bounds, rtol=1e-12)


def test_the_score_is_the_derivative_of_the_likelihood() -> None:
    rng = np.random.default_rng(1)
    known = random_poses(rng)
    prior = PosePrior.of(TeamPoses.known_within(known, DEVIATIONS))
    poses = [perturbed(pose, 1e-3 * rng.normal(size=6)) for pose in known]

    def likelihood(steps: Array) -> float:
        moved = [perturbed(pose, step) for pose, step in zip(poses[1:], steps, strict=True)]
        pairs = zip(moved, known[1:], strict=True)
        return -0.5 * sum(np.sum((perturbation_between(*pair) / DEVIATIONS[1]) ** 2) for pair in pairs)

    step = 1e-6
    expected = np.zeros((ROBOTS - 1, 6))
    for index in np.ndindex(*expected.shape):
        change = np.zeros_like(expected)
        change[index] = step
        expected[index] = (likelihood(change) - likelihood(-change)) / (2.0 * step)
    np.testing.assert_allclose(prior.score(poses), expected, rtol=1e-2, atol=1e-2 * np.abs(expected).max())


def fitted(team: Team, seed: int, is_known: bool) -> TeamPoses:
    """From few samples, and what was known before, whose error is as large as it is said to be."""
    rng = np.random.default_rng(seed)
    drawn = DEVIATIONS * rng.normal(size=DEVIATIONS.shape)
    known = tuple(perturbed(pose, error) for pose, error in zip(team.poses, drawn, strict=True))
    prior = PosePrior.of(TeamPoses.known_within(known, DEVIATIONS)) if is_known else None
    samples = team.measured(rng)
    poses = known
    for _ in range(3):
        moments = all_moments(samples, fused_motion(samples, poses, team.noise))
        scores = [score_and_information(own, pose, team.noise)[0] for own, pose in zip(moments, poses, strict=True)]
        poses = register_team(poses, np.array(scores), moments[0], team.noise, prior=prior).poses
    return fitted_poses(poses, moments[0], team.noise, prior=prior)


def test_what_was_known_and_what_is_new_add_up() -> None:
    team = make_team(3, count=ROBOTS, duration=1.0)
    runs = range(30)
    squares = []
    for seed in runs:
        found = fitted(team, seed, is_known=True)
        error = errors(team, found.poses)
        squares.append(error @ np.linalg.solve(found.covariance[6:, 6:], error))
        assert np.all(found.deviations[1:] < DEVIATIONS[1:])
        assert np.all(found.deviations[1:] < fitted(team, seed, is_known=False).deviations[1:])
    degrees = len(runs) * 6 * (len(team.poses) - 1)
    assert chi2.ppf(1e-4, degrees) < sum(squares) < chi2.ppf(1.0 - 1e-4, degrees)


def do_samples_fit(seed: int, sigmas: float) -> bool:
    """Whether they fit what was known before, where one robot is elsewhere by so many deviations."""
    team = make_team(3, count=ROBOTS, duration=1.0)
    rng = np.random.default_rng(seed)
    drawn = DEVIATIONS * rng.normal(size=DEVIATIONS.shape)
    drawn[2, 3:] += sigmas * DEVIATIONS[2, 3:]
    known = tuple(perturbed(pose, error) for pose, error in zip(team.poses, drawn, strict=True))
    samples = team.measured(rng)
    moments = all_moments(samples, fused_motion(samples, known, team.noise))
    scores = [score_and_information(own, pose, team.noise)[0] for own, pose in zip(moments, known, strict=True)]
    prior = PosePrior.of(TeamPoses.known_within(known, DEVIATIONS))
    return prior.fits(known, np.array(scores), moments[0], team.noise, NO_SLOPE, 1.0)


def test_samples_contradict_what_was_wrong_and_only_that() -> None:
    assert all(do_samples_fit(seed, 0.0) for seed in range(20))
    assert not any(do_samples_fit(seed, 20.0) for seed in range(20))


def test_without_motion_all_stays_as_it_was() -> None:
    poses = random_poses(np.random.default_rng(2))
    known = TeamPoses.known_within(poses, DEVIATIONS)
    found = fitted_poses(poses, RegistrationMoments.none(), NOISE, prior=PosePrior.of(known))
    np.testing.assert_allclose(found.covariance, known.covariance, rtol=1e-9)
