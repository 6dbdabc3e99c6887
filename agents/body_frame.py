"""How one robot comes to know its own pose in the body frame, before the team's sums begin.

Poses of the neighbours come from the twists that both measure. From neighbour to neighbour, along the shortest way to
the reference robot, they make up the robot's own pose in a frame that all share: the **body frame**.

When a robot starts again with an empty memory, or the team changes, nobody has to wait for that a second time: who knew
the poses of the team before keeps to its body frame, and tells its neighbours theirs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from agents import kinematics
from agents.estimator import Channels
from agents.known_pose import KnownPose
from coheft.estimation.observability import PoseEstimate
from coheft.estimation.spatial import Array, Pose
from coheft.estimation.twist_registration import TwistMoments, mean_square, register_twists
from coheft.wire.config import AgentConfig
from consensus.gossip import Gossip
from consensus.graph import distances

_KEPT_SIZE = 1 + KnownPose.size
"""Since which block a robot has held the load there, its pose, and how well that is known."""
_SAME = 30.0
"""Chi-square, six degrees of freedom, up to which a pose fits what a pair has measured as well as the best one does."""
_MISFIT = 5.0
"""Mean square of a pair's residuals, in units of the noise, from which on they do not fit together."""
_MISFIT_SOON = 1.5
"""The same soon after this robot has started over: what it started over for may still be among its samples."""
_SOON = 2.0
"""How soon that is [s]."""


@dataclass(frozen=True)
class KeptPoses:
    """Poses of a former team.

    Attributes:
        frame: Number of the body frame.
        poses: By name of the robot and the block since which it has held the load: when it takes hold again, it will
            be elsewhere.
    """

    frame: int
    poses: Mapping[tuple[str, int], KnownPose]


class BodyFrame:
    """What one robot knows of poses while there are no sums.

    Args:
        config: The agent's settings.
        gossip: Knows the graph.

    Attributes:
        misfits: Neighbours whose measurements did not fit the own ones when that was looked at last.
    """

    def __init__(self, config: AgentConfig, gossip: Gossip) -> None:
        self._config = config
        self._gossip = gossip
        self._pairs: dict[str, TwistMoments] = {}
        self._registered: dict[str, tuple[TwistMoments, PoseEstimate]] = {}
        self._holds: dict[str, tuple[int, int]] = {}
        self._kept: KeptPoses | None = None
        # The own pose as neighbours know it: number of the frame, since when the load has been held there, and pose.
        self._told: tuple[int, int, KnownPose] | None = None
        # The block at which this robot started over, and its pose before.
        self._started_over = -1
        self._former: Pose | None = None
        # Whether the last team has given up its poses, which were as the team before had left them.
        self._has_fallen_back = False
        self.misfits: tuple[str, ...] = ()

    def keep(self, frame: int, poses: Mapping[str, KnownPose], holds: Mapping[str, int]) -> None:
        """The team is dissolved; these were its poses, and the blocks since which its members had held the load.

        Whoever has taken hold since then is elsewhere now. An agent that started again says that it has always held it.
        """
        self.misfits, self._has_fallen_back = (), False
        if self._is_starting_over:
            self._former = poses[self._config.name].pose
        since = {name: self._gossip.records[name].since for name in poses}
        self._kept = KeptPoses(
            frame, {(name, since[name]): pose for name, pose in poses.items() if since[name] in (holds[name], 0)}
        )

    def start_over(self, block: int) -> None:
        """This robot is to begin as if it took hold at a block, but may still be where it was: samples will tell."""
        kept = self._kept_pose(self._config.name)
        if kept is not None or not self._is_starting_over:  # else it does so once more
            self._former = None if kept is None else kept.pose
        self._started_over = block

    @property
    def _is_starting_over(self) -> bool:
        return self._gossip.own.since == self._started_over

    def fall_back(self) -> None:
        """The team is dissolved, and its poses cannot be relied upon: back to those of the one before.

        If that has been in vain already, nothing is known.
        """
        self._pairs, self._holds, self.misfits = {}, {}, ()
        if self._kept is None or self._has_fallen_back:
            self._kept = self._told = self._former = None
        else:  # the last team has begun with these poses: how well they are known is not known any more
            poses = {key: KnownPose(known.pose) for key, known in self._kept.poses.items()}
            self._kept = KeptPoses(self._kept.frame, poses)
        self._has_fallen_back = self._kept is not None
        is_known = self._kept_pose(self._config.name) is not None
        # Others may know their poses in that frame as well.
        self._gossip.forget_pose(self._kept.frame if self._kept is not None and is_known else 0)

    def update_pairs(self, block: int, previous: Array | None, inbox: Mapping[str, Channels]) -> None:
        """Take in neighbours' samples of a block, and the own ones, shape (B, 15)."""
        own = self._gossip.own
        for name, channels in inbox.items():
            record = self._gossip.records.get(name)
            if record is None or not record.holding or not own.holding:
                continue
            hold = (record.since, own.since)
            if self._holds.get(name) != hold:
                self._holds[name], self._pairs[name] = hold, TwistMoments.none()
            if block < max(hold):
                continue  # told ahead: one of them is still elsewhere
            rows = channels.get(kinematics.CHANNEL)
            if previous is not None and rows is not None and kinematics.are_readable(channels, len(previous)):
                self._pairs[name] += TwistMoments.of(previous[:, :6], rows[:, :6])

    def forget_misfits(self, block: int) -> None:
        """What does not fit together was not measured at the same time, or by sensors that work: begin anew."""
        noise = self._config.noise
        is_soon = self._is_starting_over and block < self._started_over + self._config.blocks(_SOON)
        limit = _MISFIT_SOON if is_soon else _MISFIT
        self.misfits = tuple(
            name
            for name, moments in sorted(self._pairs.items())
            if moments.count > 1.0 and mean_square(moments, self._pair(name).pose, noise, noise) > limit
        )
        for name in self.misfits:
            self._pairs[name] = TwistMoments.none()

    def hear_kept_poses(self, inbox: Mapping[str, Channels]) -> None:
        """Neighbours may know this robot's pose from a former team."""
        name = self._gossip.name
        for other, channels in inbox.items():
            record, frame, rows = (
                self._gossip.records.get(other),
                channels.get("kept_frame"),
                channels.get("kept_poses"),
            )
            if record is None or frame is None or rows is None or name not in record.neighbours:
                continue
            if frame.shape == (1,) and rows.shape == (len(record.neighbours), _KEPT_SIZE):
                row = rows[record.neighbours.index(name)]
                known = KnownPose.of_numbers(row[1:])
                if frame[0] > 0.0 and known is not None:
                    self._told = int(frame[0]), int(row[0]), known

    def channels(self) -> dict[str, Array]:
        """What neighbours may need of the kept poses."""
        if self._kept is None:
            return {}
        rows = np.zeros((len(self._gossip.own.neighbours), _KEPT_SIZE))
        for row, other in zip(rows, self._gossip.own.neighbours, strict=True):
            known = self._kept_pose(other)
            if known is not None:
                row[:] = [self._gossip.records[other].since, *known.numbers()]
        return {"kept_frame": np.array([float(self._kept.frame)]), "kept_poses": rows}

    def _kept_pose(self, name: str) -> KnownPose | None:
        record = self._gossip.records.get(name)
        if self._kept is None or record is None:
            return None
        return self._kept.poses.get((name, record.since))

    def neighbours_poses(self) -> dict[str, PoseEstimate]:
        """Of those neighbours with whom samples have been exchanged."""
        return {name: self._pair(name) for name in sorted(self._pairs) if self._pairs[name].count > 1.0}

    def kept_pose(self) -> tuple[KnownPose, int] | None:
        """The own pose from a former team in the team's body frame, and the frame's number; None if there is none."""
        name, frame = self._config.name, self._gossip.frame()
        kept = self._kept_pose(name)
        if kept is not None and self._kept is not None and self._kept.frame == frame:
            return kept, frame
        if self._told is not None and self._told[:2] == (frame, self._gossip.own.since):
            return self._told[2], frame
        return None

    def found_pose(self) -> tuple[Pose, int, bool] | None:
        """The same from what neighbours have measured, and whether it is known well; None while not even roughly."""
        graph, frame = self._gossip.graph, self._gossip.frame()
        if graph is None or self._config.name not in graph:
            return None
        if frame == 0 and self._config.name == min(graph):
            if self._former is not None and self._is_starting_over:  # where it is says where the frame is
                return self._former, self._gossip.membership, True
            return Pose.identity(), self._gossip.membership, False
        found = self._through_neighbour(graph)
        own = self._gossip.own
        if found is not None:
            pose, is_former = found
            return pose, frame, is_former
        if own.pose and own.frame == frame:
            # Told to a team whose sums never began: nobody has kept it, but it is known as well as it was.
            return Pose.of_numbers(own.pose), frame, own.refined
        return None

    def _through_neighbour(self, graph: Mapping[str, tuple[str, ...]]) -> tuple[Pose, bool] | None:
        """Through the neighbour that is next on the way to the reference robot, among those that know theirs."""
        hops = distances(graph, min(graph))
        known = {other: self._gossip.pose(other) for other in graph[self._config.name] if other in self._pairs}
        for parent in sorted(known, key=lambda other: (hops[other], other)):
            parents_pose = known[parent]
            if parents_pose is None or self._pairs[parent].count <= 1.0:
                continue
            pair = self._pair(parent)
            limits = self._config.efficient
            if (
                not pair.unseen
                and np.degrees(pair.rotation_std) <= limits.start_rotation_deg
                and 1e3 * pair.translation_std <= limits.start_translation_mm
            ):
                former = self._former_pose(parent, parents_pose)
                return (parents_pose @ pair.pose.inverse(), False) if former is None else (former, True)
        return None

    def _former_pose(self, parent: str, parents_pose: Pose) -> Pose | None:
        """The own pose from before this robot started over, if what it and a neighbour have measured since fits it."""
        parents = self._gossip.records[parent]
        if self._former is None or not self._is_starting_over or not parents.refined:
            return None
        moments, noise = self._pairs[parent], self._config.noise
        squares = [
            mean_square(moments, each, noise, noise)
            for each in (self._former.inverse() @ parents_pose, self._pair(parent).pose)
        ]
        return self._former if 6.0 * moments.count * (squares[0] - squares[1]) < _SAME else None

    def _pair(self, name: str) -> PoseEstimate:
        """From all samples that were exchanged with a neighbour; found anew only after new ones."""
        moments = self._pairs[name]
        if name not in self._registered or self._registered[name][0] is not moments:
            found = register_twists(moments, self._config.noise, self._config.noise)
            self._registered[name] = moments, found
        return self._registered[name][1]
