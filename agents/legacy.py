"""What a team leaves for the next one: poses and load, as they were when nothing spoke against them."""

from __future__ import annotations

from collections.abc import Sequence

from agents.known_pose import KnownPose, passed_on
from coheft.estimation.load_comparison import KnownLoad
from coheft.estimation.spatial import Pose
from coheft.estimation.team_registration import TeamPoses


class Legacy:
    """What one robot has noted of it."""

    def __init__(self) -> None:
        self._beyond_doubt: tuple[Pose, ...] | None = None
        self._sure: TeamPoses | None = None
        # With its first block.
        self._load: tuple[KnownLoad | None, int] = None, -1

    def note_poses(self, poses: tuple[Pose, ...], sure: TeamPoses | None) -> None:
        """Nothing speaks against these poses.

        Args:
            poses: Of all robots, in the body frame.
            sure: How well they are known, if nothing can have been wrong with them unnoticed either.
        """
        self._beyond_doubt = poses
        if sure is not None:
            self._sure = sure

    def forget_sure_poses(self) -> None:
        """They were wrong."""
        self._sure = None

    def poses(self, present: Sequence[Pose] | None) -> list[KnownPose] | None:
        """Of all robots, in the body frame; None if there are none that can be relied upon.

        Args:
            present: Those in use; None if something may be wrong with them. Whatever contradicts the team's motion has
                been at work for a while when it is noticed.
        """
        if self._sure is not None:
            return passed_on(self._sure.poses, self._sure)
        kept = self._beyond_doubt if present is None else present
        return None if kept is None else [KnownPose(pose) for pose in kept]

    def note_load(self, load: KnownLoad | None, changed_at: int) -> None:
        """What the load is in the body frame since its first block; None if it is not known at the moment."""
        if load is not None:
            self._load = load, changed_at

    def load(self, changed_at: int) -> KnownLoad | None:
        """What the load is since its first block; None if that never was known."""
        load, since = self._load
        return load if since == changed_at else None
