"""One robot's estimate and the truth, as kept for curves over time."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coheft.app.results.errors import PAYLOAD_SIZE, in_full, payload_error
from coheft.app.results.judge import Judge, standard_deviations
from coheft.app.results.quantities import Quantity
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.rigid_body.mass_properties import pack_symmetric
from coheft.wire.messages.structs import Estimate, Validity


@dataclass(frozen=True, eq=False, slots=True)
class Point:
    """One estimate and the truth of its block; NaN where there is no estimate, or no truth.

    Attributes:
        is_stale: Whether the robot could not know whether its estimate still held.
        truth: True ``(m, h, J packed)`` in ``F_i``, shape (10,).
        error: Truth minus estimate, shape (10,).
        std: The robot's own standard deviations, shape (10,).
        total: True total wrench ``(f, t)`` about the origin of ``F_i``, shape (6,).
        residual: The robot's total wrench minus the true one, shape (6,).
        poses: By neighbour: error ``(rotation vector, translation)`` and standard deviation, shape (2, 6).
    """

    time: float
    block: int
    estimator: str
    is_stale: bool
    truth: Array
    error: Array
    std: Array
    total: Array
    residual: Array
    poses: dict[str, Array]


def sizes(points: Sequence[Point], quantity: Quantity, neighbour: str | None = None) -> tuple[Array, Array]:
    """Return norms of errors, and the roots of their expected squares by the own standard deviations, (n,) each."""
    rows = [(p.error, p.std) if neighbour is None else p.poses.get(neighbour, _NO_POSE) for p in points]
    table = np.array(rows).reshape(len(rows), 2, -1 if rows else PAYLOAD_SIZE)
    return np.sqrt(quantity.squares(table[:, 0])), np.sqrt(quantity.squares(table[:, 1]))


_NO_POSE = np.full((2, 6), np.nan)


def make_point(judge: Judge, estimate: Estimate) -> Point:
    """Compare an estimate with the truth of its block, which the judge must know already."""
    robot = estimate.robot
    true = judge.payload(robot, estimate.block)
    error = std = np.full(PAYLOAD_SIZE, np.nan)
    if estimate.payload is not None:
        error = in_full(payload_error(true, estimate.payload))
        std = in_full(standard_deviations(estimate.payload))
    total = residual = np.full(6, np.nan)
    known = judge.total_wrench(robot, estimate.total_block)
    if estimate.phase == "inertia" and known is not None:
        total, residual = known, estimate.total_wrench - known
    return Point(
        time=estimate.time,
        block=estimate.block,
        estimator=estimate.estimator,
        is_stale=estimate.status is Validity.STALE,
        truth=np.concatenate([[true.mass], true.com, pack_symmetric(true.tensor)]),
        error=error,
        std=std,
        total=total,
        residual=residual,
        poses={
            name: np.stack([off, np.sqrt(np.diagonal(estimate.poses[name].covariance))])
            for name, off in judge.pose_errors(estimate).items()
        },
    )
