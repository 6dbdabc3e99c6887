"""Poses are a group, twists and wrenches are carried by its adjoint."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from scipy.spatial.transform import Rotation

from coheft.estimation.geometry.spatial import (
    Array,
    Pose,
    quaternion_from_rotation,
    rotation_coefficients,
    rotation_exp,
    rotation_from_quaternion,
    rotation_log,
    skew,
)
from tests.rigid_motions import poses, quaternions, rotation_vectors, vectors


def assert_same(pose: Pose, other: Pose, atol: float = 1e-12) -> None:
    np.testing.assert_allclose(pose.rotation, other.rotation, atol=atol)
    np.testing.assert_allclose(pose.translation, other.translation, atol=atol)


@given(vectors(5.0), vectors(5.0))
def test_skew_is_the_cross_product(x: Array, y: Array) -> None:
    np.testing.assert_allclose(skew(x) @ y, np.cross(x, y), atol=1e-14)


@given(poses, poses, poses)
def test_poses_are_associative(a: Pose, b: Pose, c: Pose) -> None:
    assert_same((a @ b) @ c, a @ (b @ c))


@given(poses)
def test_poses_have_inverse_and_identity(pose: Pose) -> None:
    assert_same(pose @ pose.inverse(), Pose.identity())
    assert_same(pose.inverse() @ pose, Pose.identity())
    assert_same(pose @ Pose.identity(), pose)
    assert_same(Pose.identity() @ pose, pose)


@given(poses, poses, vectors(3.0))
def test_points_follow_composition(a: Pose, b: Pose, point: Array) -> None:
    np.testing.assert_allclose((a @ b).apply(point), a.apply(b.apply(point)), atol=1e-12)


@given(rotation_vectors)
def test_rotation_vectors_agree_with_scipy(rotation_vector: Array) -> None:
    matrix = Rotation.from_rotvec(rotation_vector).as_matrix()
    np.testing.assert_allclose(rotation_exp(rotation_vector), matrix, atol=1e-13)
    assert np.linalg.norm(rotation_log(matrix)) <= np.pi + 1e-12
    np.testing.assert_allclose(rotation_exp(rotation_log(matrix)), matrix, atol=1e-13)


@given(poses, poses)
def test_adjoint_is_a_homomorphism(a: Pose, b: Pose) -> None:
    np.testing.assert_allclose((a @ b).adjoint(), a.adjoint() @ b.adjoint(), atol=1e-12)
    np.testing.assert_allclose(a.inverse().adjoint() @ a.adjoint(), np.eye(6), atol=1e-12)


@given(poses, vectors(2.0, 6), vectors(20.0, 6))
def test_power_is_the_same_in_every_frame(pose_j_in_i: Pose, twist_j: Array, wrench_j: Array) -> None:
    w_j, v_j, f_j, t_j = twist_j[:3], twist_j[3:], wrench_j[:3], wrench_j[3:]
    twist_i, wrench_i = pose_j_in_i.adjoint() @ twist_j, pose_j_in_i.adjoint() @ wrench_j
    power_i = wrench_i[:3] @ twist_i[3:] + wrench_i[3:] @ twist_i[:3]
    np.testing.assert_allclose(power_i, f_j @ v_j + t_j @ w_j, atol=1e-10)


@given(quaternions)
def test_quaternion_round_trip(quaternion: Array) -> None:
    found = quaternion_from_rotation(rotation_from_quaternion(quaternion))
    assert found[0] >= 0.0
    # q and -q are the same rotation; compare what does not depend on the sign.
    np.testing.assert_allclose(np.outer(found, found), np.outer(quaternion, quaternion), atol=1e-12)


@given(rotation_vectors)
def test_rotation_survives_its_quaternion(rotation_vector: Array) -> None:
    rotation = rotation_exp(rotation_vector)
    quaternion = quaternion_from_rotation(rotation)
    np.testing.assert_allclose(np.linalg.norm(quaternion), 1.0, atol=1e-15)
    np.testing.assert_allclose(rotation_from_quaternion(quaternion), rotation, atol=1e-13)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 1.1e-4, 9.99e-3, 1.001e-2, 0.3, 3.0])
def test_coefficients_lose_nothing_at_small_angles(angle: float) -> None:
    terms = np.arange(12)
    powers = np.longdouble(-1.0) ** terms * np.longdouble(angle) ** (2 * terms)
    factorials = np.cumprod(np.arange(1, 28, dtype=np.longdouble))
    expected = [float((powers / factorials[2 * terms + first]).sum()) for first in range(3)]
    found = [float(each[0]) for each in rotation_coefficients(np.array([0.0, angle, 0.0]))]
    np.testing.assert_allclose(found, expected, rtol=1e-11)
