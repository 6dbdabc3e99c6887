"""The equations of rigid motion that all estimators rest on, against derivatives of poses and against particles."""

from __future__ import annotations

import numpy as np
from hypothesis import given

from coheft.estimation.geometry.body_motion import grasp_measurements
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.rigid_body.mass_properties import Inertia
from tests.rigid_motions import Particles, RigidMotion, bodies, motions, poses, vectors


@given(motions, poses, poses)
def test_twists_are_carried_between_frames(motion: RigidMotion, pose_i: Pose, pose_j: Pose) -> None:
    pose_j_in_i = pose_i.inverse() @ pose_j
    w_i, v_i, _, _ = motion.sensed(pose_i)
    w_j, v_j, _, _ = motion.sensed(pose_j)
    rotation, p = pose_j_in_i.rotation, pose_j_in_i.translation
    np.testing.assert_allclose(w_i, rotation @ w_j, atol=1e-11)
    np.testing.assert_allclose(v_i, rotation @ v_j + np.cross(p, w_i), atol=1e-11)
    np.testing.assert_allclose(np.append(w_i, v_i), pose_j_in_i.adjoint() @ np.append(w_j, v_j), atol=1e-11)


@given(poses)
def test_what_is_no_rotation_is_no_pose(pose: Pose) -> None:
    assert pose.is_rigid()
    reflected, scaled, turned = np.diag([1.0, 1.0, -1.0]), 1.001 * np.eye(3), np.full((3, 3), np.nan)
    assert not any(Pose(pose.rotation @ matrix, pose.translation).is_rigid() for matrix in (reflected, scaled, turned))
    assert not Pose(pose.rotation, pose.translation * [np.nan, 1.0, 1.0]).is_rigid()
    assert not Pose(np.zeros((3, 3)), pose.translation).is_rigid()


@given(motions, poses, poses)
def test_accelerations_are_carried_between_frames(motion: RigidMotion, pose_i: Pose, pose_j: Pose) -> None:
    pose_j_in_i = pose_i.inverse() @ pose_j
    w_i, _, a_i, alpha_i = motion.sensed(pose_i)
    _, _, a_j, alpha_j = motion.sensed(pose_j)
    rotation, p = pose_j_in_i.rotation, pose_j_in_i.translation
    np.testing.assert_allclose(alpha_i, rotation @ alpha_j, atol=1e-10)
    carried = rotation @ a_j - np.cross(alpha_i, p) - np.cross(w_i, np.cross(w_i, p))
    np.testing.assert_allclose(a_i, carried, atol=1e-10)


@given(motions, poses, poses)
def test_sensors_read_the_body_motion_at_their_grasp(motion: RigidMotion, body: Pose, pose_i: Pose) -> None:
    w, v, a, alpha = motion.sensed(body)
    read = grasp_measurements(body.inverse() @ pose_i, np.concatenate([w, v, a, alpha])[None])
    np.testing.assert_allclose(read[0], np.concatenate(motion.sensed(pose_i)[:3]), atol=1e-10)


@given(poses, vectors(50.0), vectors(2.0), vectors(5.0))
def test_wrench_is_carried_between_frames(pose_j_in_i: Pose, f_j: Array, point_j: Array, couple_j: Array) -> None:
    """A force at a point and a couple, told by their effect about either origin."""
    f_i, point_i = pose_j_in_i.rotation @ f_j, pose_j_in_i.apply(point_j)
    wrench_j = np.append(f_j, np.cross(point_j, f_j) + couple_j)
    wrench_i = np.append(f_i, np.cross(point_i, f_i) + pose_j_in_i.rotation @ couple_j)
    np.testing.assert_allclose(pose_j_in_i.adjoint() @ wrench_j, wrench_i, atol=1e-10)


@given(bodies, motions, poses)
def test_newton_euler_holds_in_every_frame(body: Particles, motion: RigidMotion, pose_i: Pose) -> None:
    seen = body.seen_from(pose_i)
    inertia = Inertia(float(seen.masses.sum()), seen.com(), seen.tensor())
    w, _, a, alpha = motion.sensed(pose_i)
    wrench = inertia.wrench(w, a, alpha)
    scale = max(1.0, float(np.abs(wrench).max()))
    np.testing.assert_allclose(wrench / scale, body.wrench(motion, pose_i) / scale, atol=1e-12)
    # The second form of Euler's law: J alpha + w x J w + h x F = T.
    force, torque, tensor = wrench[:3], wrench[3:], inertia.tensor
    euler = tensor @ alpha + np.cross(w, tensor @ w) + np.cross(inertia.com, force)
    np.testing.assert_allclose(euler / scale, torque / scale, atol=1e-12)


@given(bodies, poses, poses)
def test_mass_properties_are_carried_between_frames(body: Particles, pose_i: Pose, pose_j: Pose) -> None:
    in_i, in_j = body.seen_from(pose_i), body.seen_from(pose_j)
    carried = Inertia(float(in_j.masses.sum()), in_j.com(), in_j.tensor()).transported(pose_i.inverse() @ pose_j)
    np.testing.assert_allclose(carried.mass, in_i.masses.sum())
    np.testing.assert_allclose(carried.com, in_i.com(), atol=1e-12)
    np.testing.assert_allclose(carried.tensor, in_i.tensor(), atol=1e-11)
