"""Residuals of rows by the laws of motion alone, and their derivatives by differences."""

from __future__ import annotations

import numpy as np

from coheft.estimation.geometry.spatial import Array, skew
from coheft.estimation.moments.body import BodyModel, load_operator
from coheft.estimation.moments.unknowns import State
from tests.estimation.moments.moving_team import body_at, by_robot

STEP = 1e-5


def calibrated(state: State, rows: Array) -> Array:
    own = by_robot(rows, len(state.poses))
    return own if state.calibration is None else np.einsum("nij,tnj->tni", state.calibration, own)


def fused_products(body: BodyModel, own: Array) -> Array:
    """Matrices ``w w^T`` (n, 3, 3) as gyros show them, without what these read in excess."""
    products, w = np.zeros((2, len(own), 3, 3))
    for pose, share, y in zip(body.state.poses, body.shares, own.swapaxes(0, 1), strict=True):
        matrices = y[:, 18:24][:, [[0, 3, 4], [3, 1, 5], [4, 5, 2]]]
        products += share * pose.rotation @ matrices @ pose.rotation.T
        w[:, 0] += share * y[:, :3] @ pose.rotation.T
    gyros, turning = body.state.gyros, w[:, 0] - body.state.gyros
    mixed = turning[:, :, None] * gyros
    return products - mixed - mixed.swapaxes(1, 2) - np.outer(gyros, gyros)


def motion_residuals(body: BodyModel, rows: Array, motion: Array, offsets: Array) -> Array:
    """Of rows (n, X) for motions (n, 12) and constant offsets of twists (N, 6), in standard deviations."""
    own = calibrated(body.state, rows)
    products = fused_products(body, own)
    w, v, a, alpha = np.split(motion, 4, axis=1)
    square = products - np.trace(products, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    found = []
    for pose, offset, y in zip(body.state.poses, offsets, own.swapaxes(0, 1), strict=True):
        p, to_own = pose.translation, pose.rotation
        at_grasp = w, v + np.cross(w, p), a + np.cross(alpha, p) + square @ p, alpha
        predicted = np.hstack([vector @ to_own for vector in at_grasp])
        found.append(y[:, :12] - predicted - np.concatenate([offset, np.zeros(6)]))
    return (np.stack(found, axis=1) * np.sqrt(body.weight)).ravel()


def moved(body: BodyModel, step: Array) -> BodyModel:
    return body_at(body.state.moved(step, body.unknowns, 1e9), body.unknowns.errors, body.noise)


def jacobian_of_motion(body: BodyModel, rows: Array) -> tuple[Array, Array]:
    """Derivatives of the residuals by the unknowns, and by all motions and offsets."""
    motion, offsets = (rows @ body.motion_map.T)[:, 1:13], np.zeros((body.count, 6))
    of_unknowns, of_others = [], []
    for step in STEP * np.eye(body.unknowns.size):
        sides = [motion_residuals(moved(body, sign * step), rows, motion, offsets) for sign in (1.0, -1.0)]
        of_unknowns.append((sides[0] - sides[1]) / (2.0 * STEP))
    others = np.concatenate([motion.ravel(), offsets.ravel()])
    for axis in np.eye(len(others)):  # linear, so any step will do
        there, offset = np.split(others + axis, [motion.size])
        sides = [
            motion_residuals(body, rows, there.reshape(motion.shape), offset.reshape(offsets.shape)),
            motion_residuals(body, rows, motion, offsets),
        ]
        of_others.append(sides[0] - sides[1])
    return np.array(of_unknowns).T, np.array(of_others).T


def wrench_residuals(body: BodyModel, rows: Array) -> Array:
    """Of exact rows, with accelerations by least squares row by row, shape (n, 6)."""
    state, own = body.state, calibrated(body.state, rows)
    products, load = fused_products(body, own), state.load
    assert load is not None
    square = products - np.trace(products, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    design, read, total = [], [], np.zeros((len(rows), 6))
    for robot, (pose, y) in enumerate(zip(state.poses, own.swapaxes(0, 1), strict=True)):
        to_own, p = pose.rotation.T, pose.translation
        by_motion = np.block([[to_own, -to_own @ skew(p)], [np.zeros((3, 3)), to_own]])
        accelerations = y[:, 6:12].copy()
        accelerations[:, :3] -= square @ p @ pose.rotation
        root = np.sqrt(body.weight[robot, 6:])
        design.append(root[:, None] * by_motion)
        read.append(root * accelerations)
        total += y[:, 12:18] @ pose.adjoint().T
    found = np.linalg.lstsq(np.vstack(design), np.hstack(read).T, rcond=None)[0].T
    packed = products[:, [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    forcing = np.hstack([np.ones((len(rows), 1)), found, packed])
    return total - forcing @ load_operator(load).T


def jacobian_of_wrench(body: BodyModel, rows: Array) -> Array:
    """Shape (n, 6, u)."""
    changes = [
        wrench_residuals(moved(body, step), rows) - wrench_residuals(moved(body, -step), rows)
        for step in STEP * np.eye(body.unknowns.size)
    ]
    return np.array(changes).transpose(1, 2, 0) / (2.0 * STEP)
