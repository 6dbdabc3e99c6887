"""One robot's estimate beside the truth, as it is kept for curves over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coheft.app.results.errors import payload_error, pose_error
from coheft.app.results.judge import Judge
from coheft.app.results.quantities import PAYLOAD_SIZE, Quantity
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.rigid_body.mass_properties import pack_symmetric
from coheft.wire.messages.structs import Estimate


@dataclass(frozen=True, eq=False, slots=True)
class Point:
    """One estimate beside the truth of its block; NaN where nothing is claimed, or not known.

    Attributes:
        time: Of the estimate [s].
        block: Likewise.
        is_stale: The robot could not know whether it still held.
        truth: Of ``(m, h, J packed)`` in ``F_i``, shape (10,).
        error: Truth minus estimate, shape (10,).
        std: As claimed, shape (10,).
        total: True total wrench ``(f, t)`` about the origin of ``F_i``, shape (6,).
        residual: What the robot took it for, minus that, shape (6,).
        poses: By neighbour: error ``(rotation vector, translation)`` and standard deviation, shape (2, 6).
    """

    time: float
    block: int
    is_stale: bool
    truth: Array
    error: Array
    std: Array
    total: Array
    residual: Array
    poses: dict[str, Array]


def sizes(points: Sequence[Point], quantity: Quantity, neighbour: str | None = None) -> tuple[Array, Array]:
    """How large errors are and, by their own standard deviations, may be: roots of (expected) squares, (n,) each."""
    rows = [(p.error, p.std) if neighbour is None else p.poses.get(neighbour, _NO_POSE) for p in points]
    table = np.array(rows).reshape(len(rows), 2, -1 if rows else PAYLOAD_SIZE)
    return np.sqrt(quantity.squares(table[:, 0])), np.sqrt(quantity.squares(table[:, 1]))


_NO_POSE = np.full((2, 6), np.nan)


def make_point(judge: Judge, estimate: Estimate) -> Point:
    """Compare an estimate with the truth of its block, which the judge must know already."""
    robot = estimate.robot
    true = judge.payload(robot, estimate.block)
    error, std = np.full(PAYLOAD_SIZE, np.nan), np.full(PAYLOAD_SIZE, np.nan)
    if estimate.payload is not None:
        found = payload_error(true, estimate.payload)
        error[: len(found)] = found
        std[: len(found)] = np.sqrt(np.diagonal(estimate.payload.covariance))
    total = residual = np.full(6, np.nan)
    poses = {}
    if estimate.phase == "inertia":
        known = judge.total_wrench(robot, estimate.total_block)
        if known is not None:
            total, residual = known, estimate.total_wrench - known
        for name, pose in estimate.poses.items():
            off = pose_error(judge.relative_pose(robot, name, estimate.block), Pose(pose.rotation, pose.translation))
            poses[name] = np.stack([off, np.sqrt(np.diagonal(pose.covariance))])
    return Point(
        time=estimate.time,
        block=estimate.block,
        is_stale=estimate.status == "stale",
        truth=np.concatenate([[true.mass], true.com, pack_symmetric(true.tensor)]),
        error=error,
        std=std,
        total=total,
        residual=residual,
        poses=poses,
    )
