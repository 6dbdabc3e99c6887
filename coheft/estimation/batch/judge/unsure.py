"""Effects of uncertain grasp poses and calibration errors on the wrench, which must not refute a recording."""

from collections.abc import Sequence

import numpy as np

from coheft.estimation.batch.body import body_motions, regressor, total_wrench
from coheft.estimation.batch.calibrated_fit import force_columns
from coheft.estimation.batch.calibration import Tolerances
from coheft.estimation.batch.judge.evidence import Evidence
from coheft.estimation.batch.team_poses import derivative_by_poses
from coheft.estimation.geometry.body_motion import BODY_A
from coheft.estimation.geometry.spatial import Array, Pose, skew

_ROUNDING = 1e-9


def unsure_parameters(evidence: Evidence, motion: Array, theta: Array) -> tuple[Array, Array]:
    """Effects of uncertain grasp poses and, if they were estimated, calibration errors, by one standard deviation each.

    Returns:
        Change of the total wrench's residual by q parameters, shape (n, 6, q), and the matrices by which each robot's
        readings, with their noise, enter it, shape (N, q, 6, 6).
    """
    columns, maps = _by_grasps(evidence, theta)
    if evidence.tolerances is None:
        return columns, maps
    more, their_maps = _by_calibration(evidence, evidence.tolerances, motion, theta)
    return np.concatenate([columns, more], axis=-1), np.concatenate([maps, their_maps], axis=1)


def _by_grasps(evidence: Evidence, theta: Array) -> tuple[Array, Array]:
    signals = evidence.signals

    def left(poses: Sequence[Pose]) -> Array:
        motion = body_motions(signals, poses).mean(axis=0)
        return (total_wrench(signals.wrench, poses) - regressor(motion) @ theta).ravel()

    values, vectors = np.linalg.eigh(evidence.team.covariance)
    kept = values > _ROUNDING * values[-1]
    units = vectors[:, kept] * np.sqrt(values[kept])
    by_unit = derivative_by_poses(left, evidence.poses) @ units
    moves = np.einsum(
        "kji,kajq->kqai", [pose.rotation for pose in evidence.poses], units.reshape(-1, 2, 3, units.shape[1])
    )
    maps = np.zeros((*moves.shape[:2], 6, 6))
    maps[..., :3, :3] = maps[..., 3:, 3:] = skew(moves[:, :, 0])
    maps[..., 3:, :3] = skew(moves[:, :, 1])
    return by_unit.reshape(len(signals.time), 6, -1), maps


def _by_calibration(evidence: Evidence, tolerances: Tolerances, motion: Array, theta: Array) -> tuple[Array, Array]:
    """Scales and offsets of forces, the common scale of lengths, and the direction of gravity."""
    signals, poses = evidence.signals, evidence.poses
    assert signals.rotation is not None
    count = len(poses)
    sizes = np.repeat([tolerances.force_scale, tolerances.force_offset], [count, 3 * count])
    columns = [sizes * force_columns(signals.wrench, signals.rotation, poses)]
    to_home = signals.rotation[0] @ poses[0].rotation.T
    down = evidence.recording.gravity @ to_home
    for change, size in (
        (down, tolerances.position_scale),
        *((np.cross(axis, evidence.recording.gravity) @ to_home, evidence.tilt) for axis in np.eye(3)),
    ):
        moved = np.zeros_like(motion)
        moved[:, BODY_A] = size * change
        columns.append((regressor(moved) @ theta)[..., None])
    joined = np.concatenate(columns, axis=-1)
    maps = np.zeros((count, joined.shape[-1], 6, 6))
    maps[np.arange(count), np.arange(count)] = tolerances.force_scale * np.eye(6)
    return joined, maps
