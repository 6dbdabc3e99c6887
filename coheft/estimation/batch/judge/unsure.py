"""Effects of uncertain grasp poses and calibration errors on the wrench, which must not refute a recording."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coheft.estimation.batch.body import body_motions, regressor, total_wrench
from coheft.estimation.batch.calibration import Tolerances
from coheft.estimation.batch.judge.evidence import Evidence
from coheft.estimation.batch.pose_differences import derivative_by_poses
from coheft.estimation.geometry.body_motion import BODY_A
from coheft.estimation.geometry.spatial import Array, Pose

_ROUNDING = 1e-9


def unsure_columns(evidence: Evidence, motion: Array, theta: Array) -> Array:
    """Change of the total wrench's residual by one standard deviation of each parameter, shape (n, 6, q).

    Args:
        evidence: The recording and its grasp poses.
        motion: Motion of the body frame, shape (n, 12).
        theta: Parameters of the body, shape (10,).
    """
    columns = [_by_grasps(evidence, theta)]
    if evidence.tolerances is not None:
        columns.append(_by_calibration(evidence, evidence.tolerances, motion, theta))
    return np.concatenate(columns, axis=-1)


def _by_grasps(evidence: Evidence, theta: Array) -> Array:
    """Columns of the grasp poses."""
    signals = evidence.signals
    assert signals.wrench is not None
    wrenches = signals.wrench

    def left(poses: Sequence[Pose]) -> Array:
        motion = body_motions(signals, poses).mean(axis=0)
        result: Array = (total_wrench(wrenches, poses) - regressor(motion) @ theta).ravel()
        return result

    values, vectors = np.linalg.eigh(evidence.team.covariance)
    kept = values > _ROUNDING * values[-1]
    by_unit = derivative_by_poses(left, evidence.poses) @ (vectors[:, kept] * np.sqrt(values[kept]))
    result: Array = by_unit.reshape(len(signals.time), 6, -1)
    return result


def _by_calibration(evidence: Evidence, tolerances: Tolerances, motion: Array, theta: Array) -> Array:
    """Columns of scales and offsets of forces, the common scale of lengths, and the direction of gravity."""
    signals, poses = evidence.signals, evidence.poses
    assert signals.wrench is not None
    assert signals.rotation is not None
    columns = []
    for wrench, rotation, pose in zip(signals.wrench, signals.rotation, poses, strict=True):
        adjoint = pose.adjoint()
        columns.append(tolerances.force_scale * (wrench @ adjoint.T)[..., None])
        columns.append(tolerances.force_offset * adjoint[:, :3] @ rotation.swapaxes(-1, -2))
    to_home = signals.rotation[0] @ poses[0].rotation.T
    down = evidence.recording.gravity @ to_home
    for change, size in (
        (down, tolerances.position_scale),
        *((np.cross(axis, evidence.recording.gravity) @ to_home, evidence.tilt) for axis in np.eye(3)),
    ):
        moved = np.zeros_like(motion)
        moved[:, BODY_A] = size * change
        columns.append((regressor(moved) @ theta)[..., None])
    return np.concatenate(columns, axis=-1)
