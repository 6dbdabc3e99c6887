"""Positions of a robot that are all too large or too small by a factor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coheft.estimation.batch.judge.views import Views


@dataclass(frozen=True)
class LengthScale:
    """Of one robot.

    Attributes:
        robot: Whose.
        factor: Times which its positions are what the others' say.
        std: Standard deviation.
    """

    robot: int
    factor: float
    std: float


def find_length_scale(views: Views) -> LengthScale:
    """The factor of one robot's positions that explains most of what its view of the load differs by."""
    count, batches = views.rest.shape[:2]
    found: list[tuple[float, LengthScale]] = []
    for robot, positions in enumerate(views.positions):
        column = np.hstack([np.zeros((batches, 3)), positions]) * views.scale
        column = column - views.basis @ np.einsum("biq,bi->q", views.basis, column)
        size = float(np.sum(column**2))
        own = views.rest[robot] * count / (count - 1)
        factor = float(np.sum(column * own)) / size
        left = own - factor * column
        square = np.sum(left**2)
        # A grip that gives is no white noise.
        alike = float(np.clip(np.sum(left[1:] * left[:-1]) / square, 0.0, 0.95))
        variance = square / left.size * (1.0 + alike) / (1.0 - alike) / size
        found.append((factor**2 * size, LengthScale(robot, 1.0 + factor, float(np.sqrt(variance)))))
    return max(found, key=lambda one: one[0])[1]
