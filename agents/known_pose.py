"""A pose that a robot knows, and how well: what agents keep from one team to the next, and tell each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coheft.estimation.spatial import Array, Pose
from coheft.estimation.team_registration import TeamPoses

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


def known_from_before(poses: Sequence[KnownPose]) -> TeamPoses | None:
    """What a former team has left of all poses; None if nobody knows how well it knew one of them.

    Nor does it help if another robot than the first had defined the body frame.
    """
    deviations = [known.deviations for known in poses if known.deviations is not None]
    if len(deviations) < len(poses) or deviations[0].any():
        return None
    return TeamPoses.known_within([known.pose for known in poses], np.array(deviations))


def passed_on(poses: Sequence[Pose], fitted: TeamPoses | None) -> list[KnownPose]:
    """Inverse of ``known_from_before``: what a team leaves of its poses, ``fitted`` says how well it knows them."""
    if fitted is None:
        return [KnownPose(pose) for pose in poses]
    return [KnownPose(pose, deviations) for pose, deviations in zip(poses, fitted.bounds, strict=True)]
