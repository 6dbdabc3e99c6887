"""Grasps from twists: pairs, instruments, loops."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coheft.estimation.batch.pairs import (
    close_loops,
    expected_bias,
    grasps_from_twists,
    kabsch,
    loop_errors,
    pair_pose,
    position_between,
)
from coheft.estimation.geometry.body_motion import perturbation_between, perturbed
from coheft.estimation.geometry.spatial import Array, Pose, skew
from coheft.estimation.geometry.uncertain_pose import UncertainPose
from tests.estimation.batch_team import RATE, exact_signals, grasps, with_noise
from tests.estimation.team import random_pose
from tests.rigid_motions import poses, rotations

seeds = st.integers(0, 2**32 - 1)


@given(rotations, seeds)
def test_kabsch_finds_the_rotation(rotation: Array, seed: int) -> None:
    w_j = np.random.default_rng(seed).normal(size=(20, 3))
    np.testing.assert_allclose(kabsch(w_j @ rotation.T, w_j), rotation, atol=1e-12)


def test_kabsch_gives_a_rotation_even_where_a_reflection_fits_better() -> None:
    w = np.random.default_rng(0).normal(size=(20, 3))
    found = kabsch(-w, w)
    assert np.linalg.det(found) == pytest.approx(1.0)
    np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-12)


@given(poses, seeds)
def test_pair_pose_is_exact_without_noise(pose_j_in_i: Pose, seed: int) -> None:
    rng = np.random.default_rng(seed)
    twist_j = rng.normal(size=(50, 6))
    twist_i = twist_j @ pose_j_in_i.adjoint().T
    found = pair_pose(twist_i, twist_j, RATE)
    np.testing.assert_allclose(perturbation_between(found.pose, pose_j_in_i), 0.0, atol=1e-9)


def test_position_solves_the_normal_equations_of_least_squares() -> None:
    rng = np.random.default_rng(1)
    w_i, v_i, v_j = rng.normal(size=(3, 40, 3))
    rotation = kabsch(w_i, v_j)
    expected = np.linalg.lstsq(-skew(w_i).reshape(-1, 3), (v_i - v_j @ rotation.T).ravel())[0]
    np.testing.assert_allclose(position_between(rotation, w_i, v_i, v_j, w_i), expected, atol=1e-12)


def test_instruments_remove_the_bias_of_positions() -> None:
    """Over many noisy recordings least squares is too short beyond doubt, with instruments it is not."""
    rng = np.random.default_rng(2)
    team = grasps(rng)
    exact = exact_signals(rng, team, seconds=10.0)
    far = team[1].translation / np.linalg.norm(team[1].translation)
    errors: dict[bool, list[float]] = {False: [], True: []}
    expected = []
    for _ in range(40):
        noisy = with_noise(rng, exact, w=0.1, v=0.01, alpha=0.0, a=0.0)
        for with_instruments in errors:
            found, _ = grasps_from_twists(noisy, with_instruments)
            errors[with_instruments].append(float(far @ (found.poses[1].translation - team[1].translation)))
            if not with_instruments:
                expected.append(float(far @ expected_bias(noisy, found)[9:12]))
    means = {key: np.mean(values) for key, values in errors.items()}
    doubts = {key: np.std(values) / np.sqrt(len(values)) for key, values in errors.items()}
    assert means[False] < -10.0 * doubts[False]
    assert abs(means[True]) < 3.5 * doubts[True]
    assert np.mean(expected) == pytest.approx(means[False], abs=4.0 * doubts[False])


@pytest.mark.parametrize("count", [2, 3, 5])
def test_teams_of_all_sizes_are_found_without_noise(count: int) -> None:
    rng = np.random.default_rng(count)
    team = grasps(rng, count)
    for with_instruments in (False, True):
        found, loops = grasps_from_twists(exact_signals(rng, team), with_instruments)
        for pose, true in zip(found.poses, team, strict=True):
            np.testing.assert_allclose(perturbation_between(pose, true), 0.0, atol=1e-9)
        assert len(loops) == count * (count - 1) * (count - 2) // 6


def test_covariance_of_a_pair_says_how_much_its_pose_scatters() -> None:
    rng = np.random.default_rng(3)
    team = grasps(rng)
    exact = exact_signals(rng, team, seconds=20.0)
    squares = []
    for _ in range(60):
        noisy = with_noise(rng, exact, w=0.01, v=0.01, alpha=0.0, a=0.0)
        twists = noisy.twists
        found = pair_pose(twists[0], twists[1], RATE, instrument=twists[2][:, :3] @ team[2].rotation.T)
        error = perturbation_between(found.pose, team[1])
        squares.append(error @ np.linalg.solve(found.covariance, error) / 6.0)
    # Mean of 60 chi-squares of 6 degrees: standard deviation 0.075; covariances from 20 stretches are a little short.
    assert 0.75 < np.mean(squares) < 1.6


@given(seeds)
def test_loops_are_closed_and_exact_pairs_kept(seed: int) -> None:
    rng = np.random.default_rng(seed)
    team = grasps(rng, 4)
    spread = np.diag(rng.uniform(1e-6, 1e-4, 6))
    pairs = {(i, j): UncertainPose(team[i].inverse() @ team[j], spread) for i in range(4) for j in range(i + 1, 4)}
    found = close_loops(4, pairs)
    assert found.is_settled
    for pose, true in zip(found.poses, team, strict=True):
        np.testing.assert_allclose(perturbation_between(pose, true), 0.0, atol=1e-9)
    assert all(max(loop.rotation_deg, loop.position_mm) < 1e-6 for loop in loop_errors(pairs))


def test_pairs_that_contradict_each_other_do_not_settle() -> None:
    rng = np.random.default_rng(6)
    pairs = {(i, j): UncertainPose(random_pose(rng, 2.0), np.eye(6)) for i in range(4) for j in range(i + 1, 4)}
    assert not close_loops(4, pairs).is_settled


def test_loop_closure_listens_to_those_who_are_sure() -> None:
    rng = np.random.default_rng(5)
    team = grasps(rng)
    pairs = {
        (i, j): UncertainPose(team[i].inverse() @ team[j], (1e-6 if (i, j) != (0, 2) else 1e-2) * np.eye(6))
        for i, j in ((0, 1), (0, 2), (1, 2))
    }
    wrong = UncertainPose(perturbed(pairs[0, 2].pose, np.full(6, 0.05)), pairs[0, 2].covariance)
    found = close_loops(3, {**pairs, (0, 2): wrong})
    np.testing.assert_allclose(perturbation_between(found.poses[2], team[2]), 0.0, atol=1e-4)
    (loop,) = loop_errors({**pairs, (0, 2): wrong})[:1]
    assert loop.rotation_deg > 3.0 or loop.position_mm > 50.0
