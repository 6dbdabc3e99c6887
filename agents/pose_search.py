"""From poses that are roughly known to poses with which the load can be weighed.

Robots know their poses in the body frame roughly at first, each through its neighbours. With sums over the whole
team they find all of them jointly. What was summed with rough poses is off by terms of second order for ever: so
nothing of this is kept but the poses, and when everybody knows its own well, the team begins anew (``agents.team``).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from agents.contradictions import Contradictions
from agents.known_pose import WELL_KNOWN
from agents.pose_fits import PoseFits
from agents.sums import Entered, TeamSums
from agents.total_motion import TotalMotion
from coheft.estimation.body_motion import perturbation_between
from coheft.estimation.measurement import KINEMATICS
from coheft.estimation.observability import PoseEstimate
from coheft.estimation.registration import RegistrationMoments
from coheft.estimation.spatial import Array, Pose
from coheft.estimation.team_registration import TeamPoses, refit_map, seen_from
from coheft.wire.config import AgentConfig
from consensus.flood import Floods
from consensus.graph import Neighbours, hearing
from consensus.schedule import choose_schedule

_ROUGHLY_KNOWN = np.repeat([0.05, 0.05], 3)
"""Standard deviations at first, at the end of a chain of neighbours [rad, m]."""
_FIRST_FITS = 2.0
"""Fits of few samples, from far away, are off by so many times what they say."""


class PoseSearch:
    """One agent's part in it.

    Args:
        config: The agent's settings.
        graph: The team's.
        poses: Of all its members, roughly, by name. That of the first is what others are fitted to.
        anchor: Name of a member whose pose in the body frame stays as it is.
        start: Block at which the sums begin, the same for everybody.
    """

    def __init__(
        self, config: AgentConfig, graph: Neighbours, poses: Mapping[str, Pose], anchor: str, start: int
    ) -> None:
        self._noise = config.noise
        self._names = sorted(graph)
        self._own = self._names.index(config.name)
        self._neighbours = graph[config.name]
        self._poses = tuple(poses[name] for name in self._names)
        self._anchor, self._anchor_pose = self._names.index(anchor), poses[anchor]
        schedule = choose_schedule({name: graph[name] for name in self._names})
        self._sums = TeamSums("sums", config.name, self._neighbours, schedule, config.block, config.noise)
        self._motion = TotalMotion(config, self._poses)
        self._fits = PoseFits(config, len(self._names), self._own, start, schedule.rounds, hearing(graph), regrowth=2.0)
        self._contradictions = Contradictions(config, self._names, self._poses[self._own], _ROUGHLY_KNOWN)
        self._floods = Floods({**self._fits.floods, "misfits": self._contradictions.flood})
        self._version = 0
        self._fitted: TeamPoses | None = None
        self._next = start

    def step(self, index: int, samples: Array | None, inbox: Mapping[str, Mapping[str, Array]]) -> dict[str, Array]:
        """One block: it enters the sums, and one that entered earlier leaves them."""
        if index != self._next:
            self._sums.clear()
        self._next = index + 1
        for name, channels in inbox.items():
            self._floods.hear(name, channels)
        self._fits.step(
            index,
            self._version,
            self._poses,
            self._motion.slope,
            is_settled=True,
            is_spoilt=self._contradictions.suspect is not None,
            are_rough=False,
            come_again=True,
        )
        finished = self._sums.advance(inbox)
        self._fits.common.add(index, (None if finished is None else self._moments(*finished), None))
        pose, version = self._fits.carrying_pose(self._poses), self._fits.carried
        self._contradictions.step(index)
        self._sums.enter(None if samples is None else Entered(index, samples, pose, version))
        return self._sums.channels() | self._floods.channels()

    def _moments(self, entered: Entered, sums: Array) -> RegistrationMoments | None:
        """What a block says of the own pose; None if it is not complete, or unlike those of late."""
        block = self._motion.add(entered, sums)
        seen = None if block is None else self._motion.look_at(block, self._use_poses)
        if block is None or seen is None:
            return None
        entered, _, motion = seen
        moments = RegistrationMoments.of(entered.samples[:, KINEMATICS], motion)
        is_like_others = self._contradictions.add(moments)
        is_kept = block >= self._fits.again_before  # before it, poses were too far off
        return moments if is_like_others and is_kept else None

    def _use_poses(self, version: int) -> None:
        """All samples so far count from now on as if they had been carried with the poses of a version."""
        if version == self._version:
            return
        poses = self._fits.take_poses(version)
        self._motion.set_poses(poses)
        feature_map = refit_map(self._poses, poses, self._noise, self._motion.slope)
        self._fits.map(feature_map)
        self._contradictions.map(feature_map)
        steps = [perturbation_between(old, new) for old, new in zip(self._poses, poses, strict=True)]
        self._poses, self._version = poses, version
        # The load is not weighed with them.
        self._fitted = self._fits.known(poses, steps, self._motion.slope, untried=0.0)
        self._contradictions.use_pose(poses[self._own], _FIRST_FITS * self._fitted.deviations.max(axis=0))

    def fits(self, channels: Mapping[str, Array]) -> bool:
        """Whether what a neighbour sent has the shapes of this team."""
        return self._floods.fit(channels) and self._sums.fit(channels)

    def neighbours_poses(self) -> dict[str, PoseEstimate]:
        """What is known of them; empty as long as no poses have been fitted."""
        if self._fitted is None:
            return {}
        return seen_from(self._fitted, self._names[self._own], self._names, self._neighbours)

    def well_known_pose(self) -> Pose | None:
        """The own pose in the body frame, once the poses of the whole team are known well."""
        if self._fitted is None or self._fits.may_be_spoilt(self._version):
            return None
        if not np.all(self._fitted.deviations < WELL_KNOWN):
            return None
        return self._anchor_pose @ self._poses[self._anchor].inverse() @ self._poses[self._own]

    def doubts(self) -> tuple[str, ...]:
        """Why nothing is known yet."""
        suspect = self._contradictions.suspect
        if suspect is not None:
            return (f"what {suspect} measures contradicts how the load moves",)
        return ("the poses are still being found",)

    @property
    def must_start_over(self) -> bool:
        """Whether measurements have contradicted the team's motion for too long, or no poses can come into use.

        Where all poses are but roughly known, nobody knows whose is wrong.
        """
        return self._contradictions.anybodys_have_lasted or self._fits.are_stuck
