"""A pose that a robot knows, and how well: what agents keep from one team to the next, and tell each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coheft.estimation.spatial import Array, Pose
from coheft.estimation.team_registration import TeamPoses

WELL_KNOWN = np.repeat([8e-3, 20e-3], 3)
"""Poses are known well when all standard deviations are below these [rad, m]."""
_LEAST = 1e-6
"""No pose is known so well [rad, m], but that of the robot that defines the frame."""
_SIZE = Pose.SIZE + len(WELL_KNOWN)


@dataclass(frozen=True, eq=False)
class KnownPose:
    """A robot's pose in the body frame.

    Attributes:
        pose: It.
        deviations: How well it is known, shape (6,), see ``TeamPoses.bounds``: zero for the robot that defines the
            frame, else no larger than ``WELL_KNOWN``; None if that is not known.
    """

    size = _SIZE
    """Count of ``numbers``."""

    pose: Pose
    deviations: Array | None = None

    @staticmethod
    def of(pose: Pose, deviations: Sequence[float] | Array) -> KnownPose:
        """Of what has been told; deviations that cannot be are left out."""
        return KnownPose(pose, np.array(deviations) if _are_deviations(deviations) else None)

    def numbers(self) -> Array:
        """All of it, shape (18,)."""
        deviations = np.full(len(WELL_KNOWN), -1.0) if self.deviations is None else self.deviations
        return np.concatenate([self.pose.numbers(), deviations])

    @staticmethod
    def of_numbers(numbers: Array) -> KnownPose | None:
        """Inverse of ``numbers``; None if they are no pose."""
        pose = Pose.of_numbers(numbers[: Pose.SIZE])
        return KnownPose.of(pose, numbers[Pose.SIZE :]) if pose.is_rigid() else None


def _are_deviations(numbers: Sequence[float] | Array) -> bool:
    if len(numbers) != len(WELL_KNOWN):
        return False
    return not np.any(numbers) or bool(np.all((np.asarray(numbers) >= _LEAST) & (numbers <= WELL_KNOWN)))


def passed_on(poses: Sequence[Pose], fitted: TeamPoses) -> list[KnownPose]:
    """What a team leaves of its poses, and how well it knows them, if it knows all of them well."""
    bounds = fitted.bounds
    bounds[1:] = np.maximum(bounds[1:], _LEAST)
    if np.any(bounds > WELL_KNOWN):
        return [KnownPose(pose) for pose in poses]
    return [KnownPose(pose, deviations) for pose, deviations in zip(poses, bounds, strict=True)]


def known_from_before(poses: Sequence[KnownPose]) -> TeamPoses | None:
    """What a former team has left of all poses; None if it is not known how well it knew one of them.

    Nor does it help if another robot than the first had defined the body frame.
    """
    deviations = [known.deviations for known in poses if known.deviations is not None]
    if len(deviations) < len(poses) or [bool(each.any()) for each in deviations] != [False] + [True] * (len(poses) - 1):
        return None
    return TeamPoses.known_within([known.pose for known in poses], np.array(deviations))
