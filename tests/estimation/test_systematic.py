"""Systematic errors enter the covariance: those of poses, of the lag, and of samples of another load."""

from __future__ import annotations

from functools import partial

import numpy as np

from coheft.estimation.fan2017.joint_rls import JointRls
from coheft.estimation.fan2017.systematic import (
    covariance_by_own_pose,
    covariance_by_poses,
    inputs_by_pose_error,
    pose_error_covariance,
)
from coheft.estimation.geometry.spatial import Array, Pose, rotation_exp
from coheft.estimation.geometry.uncertain_pose import UncertainPose
from coheft.estimation.rigid_body.mass_properties import Inertia, pack_symmetric
from tests.estimation.team import make_team

WRENCH_COVARIANCE, MOTION_COVARIANCE = 1e-4 * np.eye(6), 1e-4 * np.eye(6)


def theta_of(inertia: Inertia) -> Array:
    return np.concatenate([pack_symmetric(inertia.tensor), inertia.com, [1.0 / inertia.mass]])


def filter_of(
    w: Array,
    a: Array,
    alpha: Array,
    wrench: Array,
    by_pose_error: Array | None = None,
    lag: Array | None = None,
    mean_com: Array | None = None,
    *,
    is_weighted_by_state: bool = True,
) -> JointRls:
    # Exact data deserve trust.
    covariances = 1e-12 * WRENCH_COVARIANCE, 1e-12 * MOTION_COVARIANCE
    result = JointRls(np.zeros(3), *covariances, 0.98, is_weighted_by_state=is_weighted_by_state)
    for start in [*range(0, len(w), 5)] * 3:  # the weights follow the estimate; in few samples noise is not measured
        block = slice(start, start + 5)
        more = [None if each is None else each[block] for each in (by_pose_error, lag)]
        result.update(w[block], a[block], alpha[block], wrench[block, :3], wrench[block, 3:], *more, mean_com)
    return result


def moved(wrench: Array, pose_error: Array) -> Array:
    """As it is seen if it acts elsewhere: turned by ``theta`` and moved by ``p``, exactly."""
    return wrench @ Pose(rotation_exp(pose_error[:3]), pose_error[3:]).adjoint().T


def test_the_estimate_is_off_as_pose_error_and_lag_say() -> None:
    team, rng, tiny = make_team(2, duration=4.0), np.random.default_rng(3), 1e-5
    w, a, alpha = team.exact[:, 0, :3], team.exact[:, 0, 6:9], team.motion[:, 9:]
    total = team.inertia.wrench(w, a, alpha)
    own = rng.normal(size=(len(w), 6))
    by_pose_error, off = rng.normal(size=(len(w), 3, 6)), tiny * rng.normal(size=6)
    lag = np.zeros((len(w), 12))
    lag[:, :6], lag[:, 9:] = tiny * rng.normal(size=(len(w), 6)), tiny * rng.normal(size=(len(w), 3))
    right = filter_of(w, a, alpha, total, inputs_by_pose_error(own, by_pose_error), lag)
    elsewhere = filter_of(w, a, alpha + by_pose_error @ off, total + moved(own, off) - own)
    late = filter_of(w, a, alpha - lag[:, 9:], total - lag[:, :6])
    for found, expected in ((elsewhere, right.by_pose_error @ off), (late, -right.by_lag)):
        np.testing.assert_allclose((found.theta - right.theta) / tiny, expected / tiny, rtol=2e-3, atol=2e-2)


def test_an_error_of_the_alpha_that_all_share_enters_the_mean_by_the_mean_lever_arm() -> None:
    """Three robots around the load, of which one stands elsewhere: each finds another mass, and so does the mean."""
    team, rng, tiny = make_team(2, duration=4.0), np.random.default_rng(3), 1e-5
    w, a, alpha = team.exact[:, 0, :3], team.exact[:, 0, 6:9], team.motion[:, 9:]
    total, own = team.inertia.wrench(w, a, alpha), rng.normal(size=(len(w), 6))
    by_pose_error, off = np.einsum("ijk,nk->nij", rng.normal(size=(3, 6, 3)), a), tiny * rng.normal(size=6)
    filter_alike = partial(filter_of, is_weighted_by_state=False)  # else robots weigh alpha by their own levers
    places, changes = [np.zeros(3), np.array([0.6, 0.1, -0.2]), np.array([-0.4, 0.5, 0.3])], []
    for place in places:
        there = Pose(np.eye(3), place).inverse()
        a_there = a + np.cross(alpha, place) + np.cross(w, np.cross(w, place))
        right = filter_alike(w, a_there, alpha, total @ there.adjoint().T)
        seen_off = (total + moved(own, off) - own) @ there.adjoint().T
        changes.append((filter_alike(w, a_there, alpha + by_pose_error @ off, seen_off).theta - right.theta) / tiny)
    mean_com = team.inertia.com - np.mean(places, axis=0)
    inputs = inputs_by_pose_error(own, by_pose_error)
    told = filter_alike(w, a, alpha, total, inputs, mean_com=mean_com).by_pose_error @ off / tiny
    np.testing.assert_allclose(np.mean(changes, axis=0), told, rtol=2e-3, atol=2e-3)
    assert abs(changes[0][9] / told[9]) < 0.6


def test_a_payload_is_seen_from_where_a_robot_is_off_the_mean() -> None:
    inertia = Inertia(10.0, np.array([0.1, -0.2, 0.3]), np.diag([1.0, 2.0, 2.5]))
    covariance = np.diag([1e-6, 2e-6, 3e-6, 1e-6, 4e-6, 9e-6])
    seen = covariance_by_poses(theta_of(inertia), np.zeros((10, 6)), covariance, np.zeros((10, 10)), team=6)
    np.testing.assert_allclose(seen[9], 0.0)
    rng = np.random.default_rng(1)
    errors = rng.multivariate_normal(np.zeros(6), covariance, (20000, 6))
    thetas = np.array(
        [theta_of(inertia.transported(Pose(rotation_exp(p[:3]), p[3:]))) for p in errors[:, 0] - errors.mean(1)]
    )
    np.testing.assert_allclose(
        seen, np.cov(thetas.T), atol=0.05 * np.sqrt(np.outer(seen.diagonal(), seen.diagonal())).max()
    )


def test_the_effects_of_all_pose_errors_add_up_to_that_of_the_edges() -> None:
    """Six robots with independent pose errors; their effect on the estimate, without that of their mean."""
    inertia, rng = Inertia(10.0, np.array([0.1, -0.2, 0.3]), np.diag([1.0, 2.0, 2.5])), np.random.default_rng(4)
    theta, covariance = theta_of(inertia), np.diag([1e-6, 2e-6, 3e-6, 1e-6, 4e-6, 9e-6])
    by_pose_error = rng.normal(size=(6, 10, 6))
    by_pose_error -= by_pose_error.mean(axis=0)
    mean = np.mean([covariance_by_own_pose(each, covariance) for each in by_pose_error], axis=0)
    found = covariance_by_poses(theta, by_pose_error[0], covariance, mean, team=6)
    tiny, turns = 1e-6, np.eye(6)
    seen = np.array(
        [theta_of(inertia.transported(Pose(rotation_exp(tiny * t[:3]), tiny * t[3:]))) - theta for t in turns]
    )
    derivative = np.hstack(list(by_pose_error))  # by the pose errors of all six
    derivative -= np.hstack([(seen.T / tiny) * ((k == 0) - 1 / 6) for k in range(6)])
    expected = derivative @ np.kron(np.eye(6), covariance) @ derivative.T
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-4 * np.abs(expected).max())


def test_errors_of_an_edge_at_the_middle_are_those_of_its_end_with_the_lever_arm() -> None:
    far = Pose(np.eye(3), np.array([2.0, 0.0, 0.0]))
    turn = UncertainPose(far, np.diag([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]))
    at_middle = pose_error_covariance([turn], np.array([1.0, 0.0, 0.0]))
    # Turned by one about z at x = 2, a robot at x = 0 moves by two along y.
    np.testing.assert_allclose(at_middle[np.ix_([2, 4], [2, 4])], 0.5 * np.array([[1.0, -2.0], [-2.0, 4.0]]))


def test_samples_of_another_load_pull_by_what_they_pull() -> None:
    team = make_team(3, duration=8.0)
    w, a, alpha = team.exact[:, 0, :3], team.exact[:, 0, 6:9], team.motion[:, 9:]
    heavier = Inertia(26.0, team.inertia.com + 0.05, 1.3 * team.inertia.tensor)
    rls = JointRls(np.zeros(3), WRENCH_COVARIANCE, MOTION_COVARIANCE, 0.995)
    half = len(w) // 2
    for start in range(0, len(w), 10):
        block = slice(start, start + 10)
        if start == half:
            np.testing.assert_array_equal(rls.by_old, np.zeros(10))
            np.testing.assert_array_equal(rls.covariance_of_old, np.zeros((10, 10)))
            rls.note_change()
        wrench = (team.inertia if start < half else heavier).wrench(w[block], a[block], alpha[block])
        rls.update(w[block], a[block], alpha[block], wrench[:, :3], wrench[:, 3:])
        if start == half + 100:
            off = rls.theta - theta_of(heavier)
            assert np.abs(off).max() > 0.1
            np.testing.assert_allclose(rls.by_old, off, atol=0.02 * np.abs(off).max())
            assert (np.abs(rls.by_old - off) < 4.0 * np.sqrt(rls.covariance_of_old.diagonal())).all()
