"""What a robot knows of its team and the load."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from coheft.estimation.observability import PoseEstimate
from coheft.wire.messages import PayloadEstimate


@dataclass(frozen=True)
class Found:
    """What a robot knows of its team and the load.

    Attributes:
        poses: ``pose_j_in_i`` of the neighbours.
        payload: Mass properties in ``F_i``, None while there are none.
        unseen: What of them is not observable.
        changed_at: First block of that load, -1 if it has not changed.
        learned_block: The newest block that has been looked at: nothing speaks against what is known until there.
    """

    poses: Mapping[str, PoseEstimate]
    payload: PayloadEstimate | None
    unseen: tuple[str, ...]
    changed_at: int
    learned_block: int
