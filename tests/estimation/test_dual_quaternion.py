"""The twist relation in dual quaternions, and its derivative."""

from __future__ import annotations

import numpy as np
from hypothesis import given

from coheft.estimation.fan2017.dual_quaternion import (
    dual_from_pose,
    dual_tangent,
    left_multiplication,
    pair_operator,
    pose_from_dual,
    right_multiplication,
)
from coheft.estimation.geometry.body_motion import perturbed
from coheft.estimation.geometry.spatial import Array, Pose, rotation_from_quaternion
from tests.rigid_motions import RigidMotion, motions, poses, quaternions


@given(quaternions, quaternions)
def test_products_of_quaternions_are_products_of_rotations(a: Array, b: Array) -> None:
    product = left_multiplication(a) @ b
    np.testing.assert_allclose(product, right_multiplication(b) @ a, atol=1e-15)
    expected = rotation_from_quaternion(a) @ rotation_from_quaternion(b)
    np.testing.assert_allclose(rotation_from_quaternion(product), expected, atol=1e-13)


@given(poses)
def test_round_trip(pose: Pose) -> None:
    q_r, q_d = dual_from_pose(pose)
    np.testing.assert_allclose([q_r @ q_r, q_r @ q_d], [1.0, 0.0], atol=1e-14)
    found = pose_from_dual(q_r, q_d)
    np.testing.assert_allclose(found.rotation, pose.rotation, atol=1e-13)
    np.testing.assert_allclose(found.translation, pose.translation, atol=1e-13)


@given(motions, poses, poses)
def test_twists_of_one_body_satisfy_both_relations(motion: RigidMotion, pose_i: Pose, pose_j: Pose) -> None:
    q_r, q_d = dual_from_pose(pose_i.inverse() @ pose_j)
    w_i, v_i, _, _ = motion.sensed(pose_i)
    w_j, v_j, _, _ = motion.sensed(pose_j)
    np.testing.assert_allclose(pair_operator(w_i, w_j) @ q_r, 0.0, atol=1e-12)
    np.testing.assert_allclose(pair_operator(v_i, v_j) @ q_r + pair_operator(w_i, w_j) @ q_d, 0.0, atol=1e-11)


@given(poses)
def test_dual_tangent_is_the_derivative(pose: Pose) -> None:
    q_r, q_d = dual_from_pose(pose)
    step = 1e-5
    numeric = np.empty((8, 6))
    for column, e in enumerate(step * np.eye(6)):
        ahead, behind = dual_from_pose(perturbed(pose, e)), dual_from_pose(perturbed(pose, -e))
        # Near pi the quaternion may come with the other sign: the same pose.
        ahead, behind = ([q * np.sign(dual[0] @ q_r) for q in dual] for dual in (ahead, behind))
        numeric[:, column] = (np.concatenate(ahead) - np.concatenate(behind)) / (2.0 * step)
    np.testing.assert_allclose(dual_tangent(q_r, q_d), numeric, atol=1e-9)
