"""Shares of a total wrench, and what robots push against each other, against their definitions."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.rigid_body.feedforward import internal_wrenches, load_shares, weight_deviations
from coheft.estimation.rigid_body.unobservable import middle_and_size
from tests.rigid_motions import poses, vectors

teams = st.lists(poses, min_size=3, max_size=6).filter(lambda team: middle_and_size(team)[1] > 0.1)
totals = vectors(50.0, 6)


def total_of(wrenches: Array, team: list[Pose]) -> Array:
    return np.sum([pose.adjoint() @ wrench for pose, wrench in zip(team, wrenches, strict=True)], axis=0)


@given(teams, totals)
def test_shares_add_up_to_the_total(team: list[Pose], total: Array) -> None:
    np.testing.assert_allclose(total_of(load_shares(team) @ total, team), total, atol=1e-8)


@given(teams, totals, poses)
def test_shares_do_not_depend_on_the_body_frame(team: list[Pose], total: Array, body: Pose) -> None:
    seen = [body @ pose for pose in team]
    np.testing.assert_allclose(load_shares(seen) @ body.adjoint() @ total, load_shares(team) @ total, atol=1e-7)


@given(teams, totals)
def test_shares_are_the_least_wrenches_with_that_total(team: list[Pose], total: Array) -> None:
    _, size = middle_and_size(team)
    weights = np.tile(np.repeat([1.0, size], 3), len(team))
    grasp_map = np.hstack([pose.adjoint() for pose in team])
    least = weights * (np.linalg.pinv(grasp_map * weights) @ total)
    np.testing.assert_allclose((load_shares(team) @ total).ravel(), least, atol=1e-7)


@given(teams, st.data())
def test_internal_wrenches_move_nothing_and_are_all_that_shares_leave(team: list[Pose], data: st.DataObject) -> None:
    wrenches = data.draw(vectors(50.0, 6 * len(team))).reshape(-1, 6)
    internal = internal_wrenches(wrenches, team)
    np.testing.assert_allclose(total_of(internal, team), 0.0, atol=1e-7)
    np.testing.assert_allclose(internal_wrenches(internal, team), internal, atol=1e-7)
    np.testing.assert_allclose(internal_wrenches(load_shares(team) @ total_of(wrenches, team), team), 0.0, atol=1e-7)


def test_two_that_pull_at_a_rod_push_against_each_other() -> None:
    team = [Pose(np.eye(3), np.array([x, 0.0, 0.0])) for x in (-0.5, 0.5)]
    pull = np.array([[-7.0, 0, 0, 0, 0, 0], [7.0, 0, 0, 0, 0, 0]])
    np.testing.assert_allclose(internal_wrenches(pull, team), pull, atol=1e-12)


def test_where_the_centre_of_mass_lies_along_gravity_does_not_matter() -> None:
    covariance = np.diag([0.2, 0.01, 0.02, 9.0]) ** 2
    force, torque = weight_deviations(5.0, covariance, np.array([0.0, 0.0, 9.81]))
    np.testing.assert_allclose(force, 0.2 * 9.81)
    np.testing.assert_allclose(torque, 5.0 * 9.81 * np.hypot(0.01, 0.02))
