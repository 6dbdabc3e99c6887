"""Pairwise poses from twists: exactness, invariance, efficiency, honesty, and what cannot be seen."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from coheft.estimation.body_motion import perturbation_between, perturbed
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.observability import PoseEstimate
from coheft.estimation.spatial import Array, Pose
from coheft.estimation.twist_registration import (
    TwistMoments,
    adjoint_derivative,
    closed_form_pose,
    mean_square,
    register_twists,
)
from tests.estimation.team import Team, make_team, random_pose

NOISE = SensorNoise()


def register(samples: Array, noise: SensorNoise = NOISE, centred: bool = True) -> PoseEstimate:
    """``pose_2_in_1`` of robots 1 and 2, from samples (n, N, 15)."""
    return register_twists(TwistMoments.of(samples[:, 1, :6], samples[:, 2, :6]), noise, noise, centred)


def true_pose(team: Team) -> Pose:
    return team.poses[1].inverse() @ team.poses[2]


def pair_bound(team: Team, noise: SensorNoise) -> Array:
    """Cramér-Rao bound from one pair's twists, the true twist of every sample being unknown, sample by sample."""
    pose, step = true_pose(team), 1e-6
    adjoint = pose.adjoint()
    variances = np.diag(np.square(noise.per_column()[:6]))
    weight = np.linalg.inv(variances + adjoint @ variances @ adjoint.T)
    twists = team.exact[:, 2, :6] - team.exact[:, 2, :6].mean(axis=0)
    columns = [
        twists @ (perturbed(pose, step * e).adjoint() - perturbed(pose, -step * e).adjoint()).T / (2 * step)
        for e in np.eye(6)
    ]
    jacobian = np.stack(columns, axis=2)
    return np.linalg.inv(np.einsum("nak,ab,nbl->kl", jacobian, weight, jacobian))


def test_adjoint_derivative() -> None:
    pose, step = random_pose(np.random.default_rng(1)), 1e-6
    for analytic, e in zip(adjoint_derivative(pose), np.eye(6), strict=True):
        numeric = (perturbed(pose, step * e).adjoint() - perturbed(pose, -step * e).adjoint()) / (2 * step)
        np.testing.assert_allclose(analytic, numeric, atol=1e-9)


@pytest.mark.parametrize("late", [0, 2])
def test_residuals_are_those_of_the_noise_unless_clocks_are_apart(late: int) -> None:
    team = make_team(1, count=3, duration=5.0)
    samples = team.measured(np.random.default_rng(0)) + 3.0 * NOISE.per_column()  # offsets do not matter
    moments = TwistMoments.of(samples[late:, 1, :6], samples[: len(samples) - late, 2, :6])
    found = register_twists(moments, NOISE, NOISE)
    value = mean_square(moments, found.pose, NOISE, NOISE)
    assert value == pytest.approx(1.0, abs=0.1) if late == 0 else value > 5.0


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("centred", [False, True])
def test_exact_data_give_the_exact_pose(seed: int, centred: bool) -> None:
    team = make_team(seed, count=3, duration=5.0)
    estimate = register(team.exact, centred=centred)
    assert np.abs(perturbation_between(true_pose(team), estimate.pose)).max() < 1e-9
    assert not estimate.unseen


def test_closed_form_is_exact_on_exact_data() -> None:
    team = make_team(1, count=3, duration=5.0)
    variances = np.square(1e-6 * NOISE.per_column()[:6])
    second, _ = TwistMoments.of(team.exact[:, 1, :6], team.exact[:, 2, :6]).second(centred=False)
    start = closed_form_pose(second, variances, variances)
    assert np.abs(perturbation_between(true_pose(team), start)).max() < 1e-8


def test_blocks_add_up_and_offsets_drop_out() -> None:
    team = make_team(1, count=3, duration=10.0)
    samples = team.measured(np.random.default_rng(0))
    offset = np.random.default_rng(1).uniform(-0.05, 0.05, (3, 15))
    whole = register(samples)
    moments = TwistMoments.none()
    for block in np.split(samples + offset, 50):
        moments = moments + TwistMoments.of(block[:, 1, :6], block[:, 2, :6])
    estimate = register_twists(moments, NOISE, NOISE)
    assert np.abs(perturbation_between(whole.pose, estimate.pose)).max() < 1e-9
    np.testing.assert_allclose(estimate.covariance, whole.covariance, rtol=1e-6, atol=1e-12)


def test_rotated_frames_give_the_rotated_estimate() -> None:
    """Gyro and velocity noise are isotropic: turning F_i or F_j turns the estimate and its covariance with it."""
    team = make_team(4, count=3, duration=5.0)
    samples = team.measured(np.random.default_rng(0))
    turn = Pose(random_pose(np.random.default_rng(2)).rotation, np.zeros(3))
    before = register(samples)
    turned_i, turned_j = samples.copy(), samples.copy()
    turned_i[:, 1, :6] = samples[:, 1, :6] @ turn.adjoint().T
    turned_j[:, 2, :6] = samples[:, 2, :6] @ turn.adjoint().T
    after_i, after_j = register(turned_i), register(turned_j)
    assert np.abs(perturbation_between(turn @ before.pose, after_i.pose)).max() < 1e-9
    assert np.abs(perturbation_between(before.pose @ turn.inverse(), after_j.pose)).max() < 1e-9
    both = np.kron(np.eye(2), turn.rotation)
    np.testing.assert_allclose(after_i.covariance, both @ before.covariance @ both.T, atol=1e-11)


@pytest.mark.parametrize("scale", [1.0, 10.0])
def test_reaches_the_bound_and_knows_it(scale: float) -> None:
    noise = NOISE.scaled(scale)
    team = make_team(2, count=3, rate=100.0, duration=10.0, noise=noise)
    rng = np.random.default_rng(0)
    runs = 200
    estimates = [register(team.measured(rng), noise) for _ in range(runs)]
    errors = np.array([perturbation_between(true_pose(team), estimate.pose) for estimate in estimates])
    nees = sum(e @ np.linalg.solve(s.covariance, e) for e, s in zip(errors, estimates, strict=True))
    low, high = chi2.ppf([1e-4, 1 - 1e-4], errors.size)
    assert low < nees < high
    # Ten times the noise leaves twists of 0.4 rad/s with 0.05 rad/s of noise: no longer quite at the bound.
    ratio = np.sqrt(np.mean(errors**2, axis=0) / np.diag(pair_bound(team, noise)))
    assert np.all(ratio < 1.2)


def test_single_axis_hides_the_translation_along_it() -> None:
    team = make_team(3, count=3, duration=20.0, single_axis=True)
    estimate = register(team.measured(np.random.default_rng(0)))
    w = team.exact[:, 1, :3]
    axis = w[np.argmax(np.linalg.norm(w, axis=1))]
    axis = axis / np.linalg.norm(axis)
    (unseen,) = estimate.unseen
    assert np.linalg.norm(unseen.rotation) < 0.01
    assert abs(unseen.translation @ axis) > 0.999
    x, y, z = axis * np.sign(axis[np.argmax(np.abs(axis))])
    assert str(unseen).startswith("translation along (")
    np.testing.assert_allclose([float(s) for s in str(unseen)[19:-1].split(",")], [x, y, z], atol=0.05)
    error = perturbation_between(true_pose(team), estimate.pose)
    across = np.eye(3) - np.outer(axis, axis)
    assert np.linalg.norm(error[:3]) < 0.02
    assert np.linalg.norm(across @ error[3:]) < 0.02


def test_at_rest_nothing_is_seen() -> None:
    team = make_team(3, count=3, duration=20.0)
    still = np.zeros_like(team.exact) + np.random.default_rng(0).normal(size=team.exact.shape) * NOISE.per_column()
    words = [str(direction) for direction in register(still).unseen]
    assert sorted(words) == [
        "rotation about (0.00, 0.00, 1.00)",
        "rotation about (0.00, 1.00, 0.00)",
        "rotation about (1.00, 0.00, 0.00)",
        "translation along (0.00, 0.00, 1.00)",
        "translation along (0.00, 1.00, 0.00)",
        "translation along (1.00, 0.00, 0.00)",
    ]


@pytest.mark.parametrize("count", [0, 1, 100])
def test_without_any_motion_nothing_is_seen_and_frames_count_as_parallel(count: int) -> None:
    constant = np.broadcast_to([0.5, -0.25, 0.125, 1.0, 0.0, -2.0], (count, 6))  # exact in binary, so are their sums
    for twists in (constant, np.zeros((count, 6))):
        moments = TwistMoments.of(twists, twists[:, ::-1])
        found = register_twists(moments, NOISE, NOISE)
        assert len(found.unseen) == 6
        np.testing.assert_array_equal(found.pose.rotation, np.eye(3))
        np.testing.assert_array_equal(found.pose.translation, np.zeros(3))
        assert np.isfinite(found.covariance).all()
        assert mean_square(moments, found.pose, NOISE, NOISE) == 0.0


def test_shapes_are_checked() -> None:
    with pytest.raises(ValueError, match=r"expected \(n, 6\) twice"):
        TwistMoments.of(np.zeros((5, 6)), np.zeros((4, 6)))
