"""What stays off enters the covariance by itself: places of robots, the lag, a load from before."""

from __future__ import annotations

import numpy as np

from coheft.estimation.fan2017.joint_rls import JointRls
from coheft.estimation.fan2017.systematic import (
    causes,
    covariance_of_poses,
    inputs_by_causes,
    place_covariance,
)
from coheft.estimation.geometry.spatial import Array, Pose, rotation_exp
from coheft.estimation.geometry.uncertain_pose import UncertainPose
from coheft.estimation.rigid_body.mass_properties import Inertia, pack_symmetric
from tests.estimation.team import make_team

WRENCH_COVARIANCE, MOTION_COVARIANCE = 1e-4 * np.eye(6), 1e-4 * np.eye(6)


def theta_of(inertia: Inertia) -> Array:
    return np.concatenate([pack_symmetric(inertia.tensor), inertia.com, [1.0 / inertia.mass]])


def filter_of(w: Array, a: Array, alpha: Array, wrench: Array, by_causes: Array | None = None) -> JointRls:
    result = JointRls(
        np.zeros(3), 1e-12 * WRENCH_COVARIANCE, 1e-12 * MOTION_COVARIANCE, 0.98, causes=causes(1)
    )  # exact data deserve trust
    for _ in range(3):  # the weights follow the estimate
        result.update(w, a, alpha, wrench[:, :3], wrench[:, 3:], by_causes)
    return result


def moved(wrench: Array, place: Array) -> Array:
    """As it is seen if it acts elsewhere: turned by ``theta`` and moved by ``p``, exactly."""
    return wrench @ Pose(rotation_exp(place[:3]), place[3:]).adjoint().T


def test_the_estimate_is_off_as_the_causes_say() -> None:
    team, rng, tiny = make_team(2, duration=4.0), np.random.default_rng(3), 1e-5
    w, a, alpha = team.exact[:, 0, :3], team.exact[:, 0, 6:9], team.motion[:, 9:]
    total = team.inertia.wrench(w, a, alpha)
    own = rng.normal(size=(len(w), 6))
    lag, by_poses = rng.normal(size=(len(w), 9)), rng.normal(size=(len(w), 3, 6))
    right = filter_of(w, a, alpha, total, inputs_by_causes(own, lag, by_poses))
    off = tiny * rng.normal(size=causes(1))
    wrong = total + moved(own, off[:6]) - own + off[6] * lag[:, :6]
    found = filter_of(w, a, alpha + off[6] * lag[:, 6:] + by_poses @ off[7:], wrong)
    np.testing.assert_allclose((found.theta - right.theta) / tiny, right.by_causes @ off / tiny, rtol=2e-3, atol=2e-2)


def test_a_payload_that_all_see_from_a_wrong_place_is_off_by_that() -> None:
    """One robot that carries all: its own place cancels, what is left is nothing; many robots': the place itself."""
    inertia = Inertia(10.0, np.array([0.1, -0.2, 0.3]), np.diag([1.0, 2.0, 2.5]))
    place = np.diag([1e-6, 2e-6, 3e-6, 1e-6, 4e-6, 9e-6])
    seen = covariance_of_poses(theta_of(inertia), np.zeros((10, 7)), place, [], team=6, sharing=6)
    np.testing.assert_allclose(seen[9], 0.0)
    rng = np.random.default_rng(1)
    places = rng.multivariate_normal(np.zeros(6), place, 20000)
    thetas = np.array([theta_of(inertia.carried(Pose(rotation_exp(p[:3]), p[3:]))) for p in places])
    np.testing.assert_allclose(
        seen, np.cov(thetas.T), atol=0.05 * np.sqrt(np.outer(seen.diagonal(), seen.diagonal())).max()
    )


def test_errors_of_an_edge_at_the_middle_are_those_of_its_end_with_the_lever_arm() -> None:
    far = Pose(np.eye(3), np.array([2.0, 0.0, 0.0]))
    turn = UncertainPose(far, np.diag([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]))
    at_middle = place_covariance([turn], np.array([1.0, 0.0, 0.0]), variance=0.5)
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
            np.testing.assert_array_equal(rls.pull_of_old, np.zeros(10))
            rls.note_change()
        wrench = (team.inertia if start < half else heavier).wrench(w[block], a[block], alpha[block])
        rls.update(w[block], a[block], alpha[block], wrench[:, :3], wrench[:, 3:])
        if start == half + 100:
            off = rls.theta - theta_of(heavier)
            assert np.abs(off).max() > 0.1
            np.testing.assert_allclose(rls.pull_of_old, off, atol=0.02 * np.abs(off).max())
