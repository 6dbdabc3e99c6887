"""A pose that a robot knows, and how well: what agents keep from one team to the next, and tell each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coheft.estimation.spatial import Array, Pose

_POSE_SIZE, _SIZE = 12, 18
_LARGEST = 1.0
"""Deviations from this on say nothing [rad, m]."""


@dataclass(frozen=True, eq=False)
class KnownPose:
    """A robot's pose in the body frame.

    Attributes:
        pose: It.
        deviations: How well it is known, shape (6,), see ``TeamPoses.bounds``; None if nobody knows.
    """

    size = _SIZE
    """Count of ``numbers``."""

    pose: Pose
    deviations: Array | None = None

    def numbers(self) -> Array:
        """All of it, 18 numbers."""
        deviations = np.full(_SIZE - _POSE_SIZE, -1.0) if self.deviations is None else self.deviations
        return np.concatenate([self.pose.numbers(), deviations])

    @staticmethod
    def of_numbers(numbers: Array) -> KnownPose | None:
        """Inverse of ``numbers``; None if they are no pose."""
        pose, deviations = Pose.of_numbers(numbers[:_POSE_SIZE]), numbers[_POSE_SIZE:]
        return KnownPose(pose, deviations if are_deviations(deviations) else None) if pose.is_rigid() else None


def are_deviations(numbers: Sequence[float] | Array) -> bool:
    """Whether these can be the six standard deviations of a pose; the pose that defines the frame has none."""
    return len(numbers) == _SIZE - _POSE_SIZE and all(0.0 <= number < _LARGEST for number in numbers)
