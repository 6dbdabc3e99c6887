"""Hands on the handle: what they do together, at what effort, and where best."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coheft.estimation.cart.contact import MOVING, BestContact, effort, grasp_map, leverage, share
from coheft.estimation.geometry.spatial import Array, Pose
from tests.cart.carts import vectors

ARM = 0.1
contacts = st.tuples(st.floats(-0.6, 0.6), st.floats(-0.6, 0.6)).map(np.array)
wrenches = vectors(3, 80.0)


@given(contacts, wrenches)
def test_the_grasp_map_is_the_planar_part_of_the_adjoint(contact: Array, wrench: Array) -> None:
    pose = Pose(np.eye(3), np.append(contact, 0.0))
    spatial = pose.adjoint() @ np.array([wrench[0], wrench[1], 0.0, 0.0, 0.0, wrench[2]])
    np.testing.assert_allclose(grasp_map(contact) @ wrench, spatial[[0, 1, 5]], atol=1e-9)


@given(st.lists(contacts, min_size=1, max_size=4), wrenches)
def test_shares_add_up_with_the_least_effort(hands: list[Array], wrench_b: Array) -> None:
    total = np.sum([leverage(hand, ARM) for hand in hands], axis=0)
    shares = [share(wrench_b, hand, ARM, total) for hand in hands]
    done = np.sum([grasp_map(hand) @ own for hand, own in zip(hands, shares, strict=True)], axis=0)
    np.testing.assert_allclose(done[MOVING], wrench_b[MOVING], atol=1e-8)

    # Least squares of smallest norm, in forces and torques per arm.
    scale = np.diag([1.0, 1.0, ARM])
    together = np.hstack([grasp_map(hand)[MOVING] @ scale for hand in hands])
    expected = np.linalg.lstsq(together, wrench_b[MOVING], rcond=None)[0]
    np.testing.assert_allclose(np.concatenate([np.linalg.solve(scale, own) for own in shares]), expected, atol=1e-7)
    assert effort(wrench_b, total) == pytest.approx(float(np.linalg.norm(expected)), abs=1e-7)


def test_leverage_is_the_covariance_of_what_a_hand_feels() -> None:
    hand = np.array([-0.25, 0.2])
    rng = np.random.default_rng(1)
    noise = rng.standard_normal((200_000, 3)) * [1.0, 1.0, ARM] @ grasp_map(hand).T
    np.testing.assert_allclose(np.cov(noise.T), leverage(hand, ARM), atol=0.02)


@given(st.lists(st.tuples(st.floats(1.0, 60.0), st.floats(-8.0, 8.0)), min_size=1, max_size=6))
def test_the_best_contact_takes_the_least_effort(pushes: list[tuple[float, float]]) -> None:
    search = BestContact(memory=1e9)
    for force, torque in pushes:
        best = search.after(np.array([force, 0.0, torque]))

    def total(y: float) -> float:
        all_leverage = leverage(np.array([-0.25, y]), ARM)
        return sum(effort(np.array([force, 0.0, torque]), all_leverage) ** 2 for force, torque in pushes)

    assert best is not None
    assert total(best) <= min(total(best + away) for away in (-0.2, -0.01, 0.01, 0.2)) + 1e-9


def test_the_best_contact_is_not_known_before_a_push() -> None:
    assert BestContact(memory=10.0).after(np.zeros(3)) is None


def test_an_old_push_counts_less() -> None:
    search = BestContact(memory=5.0)
    search.after(np.array([10.0, 0.0, 2.0]))
    for _ in range(50):
        best = search.after(np.array([10.0, 0.0, -1.0]))
    assert best == pytest.approx(0.1, abs=1e-4)
