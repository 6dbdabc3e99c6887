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
from agents.pose_fits import STILL_FOUND, PoseFits
from agents.poses_in_use import PosesInUse
from agents.sums import Entered, TeamSums
from coheft.estimation.measurement import KINEMATICS
from coheft.estimation.observability import PoseEstimate
from coheft.estimation.registration import RegistrationMoments
from coheft.estimation.spatial import Array, Pose
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
        names = sorted(graph)
        own = names.index(config.name)
        self._neighbours = graph[config.name]
        self._anchor, self._anchor_pose = names.index(anchor), poses[anchor]
        schedule = choose_schedule({name: graph[name] for name in names})
        self._sums = TeamSums("sums", config.name, self._neighbours, schedule, config.block, config.noise)
        self._fits = PoseFits(config, len(names), own, start, schedule.rounds, hearing(graph), regrowth=2.0)
        self._contradictions = Contradictions(config, names, poses[config.name], _ROUGHLY_KNOWN)
        self._in_use = PosesInUse(
            config,
            names,
            tuple(poses[name] for name in names),
            None,
            self._fits,
            self._contradictions,
            optimism=_FIRST_FITS,
            untried=0.0,  # the load is not weighed with them
        )
        self._floods = Floods({**self._fits.floods, "misfits": self._contradictions.flood})
        self._next = start

    def step(self, index: int, samples: Array | None, inbox: Mapping[str, Mapping[str, Array]]) -> dict[str, Array]:
        """One block: it enters the sums, and one that entered earlier leaves them."""
        if index != self._next:
            self._sums.clear()
        self._next = index + 1
        for name, channels in inbox.items():
            self._floods.hear(name, channels)
        is_spoilt = self._contradictions.suspect is not None
        self._in_use.fit(index, is_settled=True, is_spoilt=is_spoilt, are_rough=False, come_again=True)
        finished = self._sums.advance(inbox)
        self._fits.common.add(index, (None if finished is None else self._moments(*finished), None))
        entering = self._in_use.carried(index, samples)
        self._contradictions.step(index)
        self._sums.enter(entering)
        return self._sums.channels() | self._floods.channels()

    def _moments(self, entered: Entered, sums: Array) -> RegistrationMoments | None:
        """What a block says of the own pose; None if it is not complete, or unlike those of late."""
        block = self._in_use.motion.add(entered, sums)
        seen = None if block is None else self._in_use.motion.look_at(block, self._use_poses)
        if block is None or seen is None:
            return None
        entered, _, motion = seen
        moments = RegistrationMoments.of(entered.samples[:, KINEMATICS], motion)
        is_like_others = self._contradictions.add(moments)
        is_kept = block >= self._fits.again_before  # before it, poses were too far off
        return moments if is_like_others and is_kept else None

    def _use_poses(self, version: int) -> None:
        if version != self._in_use.version:
            self._in_use.switch(version)

    def fits(self, channels: Mapping[str, Array]) -> bool:
        """Whether what a neighbour sent has the shapes of this team."""
        return self._floods.fit(channels) and self._sums.fit(channels)

    def neighbours_poses(self) -> Mapping[str, PoseEstimate]:
        """What is known of them; empty as long as no poses have been fitted."""
        return self._in_use.neighbours(self._neighbours)

    def well_known_pose(self) -> Pose | None:
        """The own pose in the body frame, once the poses of the whole team are known well."""
        known = self._in_use.known
        if known is None or self._in_use.may_be_spoilt or not np.all(known.deviations < WELL_KNOWN):
            return None
        return self._anchor_pose @ self._in_use.poses[self._anchor].inverse() @ self._in_use.own

    def doubts(self) -> tuple[str, ...]:
        """Why nothing is known yet."""
        return (self._contradictions.doubt or STILL_FOUND,)

    @property
    def must_start_over(self) -> bool:
        """Whether measurements have contradicted the team's motion for too long, or no poses can come into use.

        Where all poses are but roughly known, nobody knows whose is wrong.
        """
        return self._contradictions.anybodys_have_lasted or self._fits.are_stuck
