"""A robot's share of the team's work: exact sums, joint poses, and the load's inertia, all in the body frame.

Poses are fitted again and again (``agents.pose_fits``). When the first block that was carried with new poses leaves the
sums, the motions of all samples are *mapped* to the new poses, and each robot tells how its own wrench followed from
the motion; when all have been heard, the total wrenches are *corrected* for the new poses as well. So what was
accumulated always is, to first order, what the newest poses would have given for all samples so far.

What a robot knows of itself goes into the sums unchecked, so all robots watch whether the sums can be true
(``agents.contradictions``), learn nothing while they cannot, and say whose sensors contradict them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from agents.completeness import Completeness
from agents.contradictions import Contradictions
from agents.early_sums import PACE, EarlySums
from agents.found import Found
from agents.held_block import Block, HeldBlock
from agents.known_pose import WELL_KNOWN, KnownPose, known_from_before
from agents.legacy import Legacy
from agents.load_changes import LoadChanges
from agents.load_memory import LoadMemory
from agents.load_moments import block_moments
from agents.pose_fits import STILL_FOUND, UNNOTICED, PoseFits
from agents.poses_in_use import PosesInUse
from agents.sums import Entered, TeamSums
from agents.watch import block_misfit
from coheft.estimation.load_comparison import KnownLoad
from coheft.estimation.registration import RegistrationMoments
from coheft.estimation.spatial import Array, Pose
from coheft.estimation.team_registration import PosePrior
from coheft.wire.config import AgentConfig
from consensus.flood import Flood, Floods
from consensus.graph import Neighbours, hearing
from consensus.schedule import choose_schedule

_LITTLE = 0.5
"""When a fit moves no pose by more of its standard deviations, it does not matter with which ones samples are seen."""
_NONSENSE = 15.0
"""A block whose squared residuals to the motion of the body are so many times what they should be is not used."""
_UNLIKELY = 3.0
"""The same for samples from before the start: there is no hurry to use them."""


class Team:
    """State of one agent since the sums of a team began.

    Args:
        config: The agent's settings.
        graph: The team's.
        poses: Of all its members, well known, by name. That of the first defines the body frame. If it is known how
            well, of all of them, the load is weighed with them at once.
        start: Block at which the sums begin, the same for everybody.
        history: Own samples of the blocks before, by number.
        load_changes: Told of those that are noticed.
        former: What a former team knew of the load, in the same body frame.

    Attributes:
        total_block: Block of the newest total, -1 while there is none.
    """

    def __init__(
        self,
        config: AgentConfig,
        graph: Neighbours,
        poses: Mapping[str, KnownPose],
        start: int,
        history: Mapping[int, Array],
        load_changes: LoadChanges,
        former: KnownLoad | None = None,
    ) -> None:
        self._config = config
        self._names = sorted(graph)
        self._own = self._names.index(config.name)
        self._neighbours = graph[config.name]
        members = [poses[name] for name in self._names]
        known = known_from_before(members)
        schedule = choose_schedule({name: graph[name] for name in self._names})
        self._sums = TeamSums("sums", config.name, self._neighbours, schedule, config.block, config.noise)
        self._early_sums = EarlySums(config, self._neighbours, schedule, start, history)
        self._next = start
        self._hearing = hearing(graph)

        prior, deviations, settling = None, WELL_KNOWN, 0
        if known is not None:
            prior, deviations = PosePrior.of(known), known.deviations.max(axis=0)
            settling = config.blocks(UNNOTICED)
        self._fits = PoseFits(
            config, len(members), self._own, start, schedule.rounds, self._hearing, regrowth=1.0, prior=prior
        )
        self._contradictions = Contradictions(config, self._names, members[self._own].pose, deviations)
        at_first = tuple(member.pose for member in members)
        self._in_use = PosesInUse(config, self._names, at_first, known, self._fits, self._contradictions)
        self._memory = LoadMemory(config, self._own, at_first, self._in_use.motion.fusion, known, former)
        # Version of the poses that wrenches of the past are corrected for.
        self._corrected = 0
        self._largest_step = np.inf if known is None else 0.0
        # The last start of the early sums that the memory knows of.
        self._counted_from = start
        self._legacy = Legacy()
        self._found_before: Found | None = None
        self._wrenches = Flood(len(members), LoadMemory.told_size)
        self._floods = Floods(
            {
                **self._fits.floods,
                "wrenches": self._wrenches,
                "misfits": self._contradictions.flood,
            }
        )
        self._held = HeldBlock()
        self._is_contradicted = False
        self._completeness = Completeness(config, schedule.rounds, settling)
        self.total_block, self._total = -1, (Pose.identity(), np.zeros(6))
        self._load_changes = load_changes

    def step(self, index: int, samples: Array | None, inbox: Mapping[str, Mapping[str, Array]]) -> dict[str, Array]:
        """One block: it enters the sums, and one that entered earlier leaves them."""
        if index != self._next:
            self._sums.clear()
            self._early_sums.clear()
        self._next = index + 1
        if samples is not None and not self._is_contradicted:
            self._early_sums.remember(index, samples)
        for name, channels in inbox.items():
            self._floods.hear(name, channels)
            self._hear_of_change(channels.get("load_change"), index)
        self._look_for_contradictions(index)
        self._fit_poses(index)
        finished = self._sums.advance(inbox)
        newest = None if finished is None else self._take_in(*finished, index)
        self._sums.enter(self._in_use.carried(index, samples))
        told = self._sums.channels()
        early = None
        if not self._early_sums.are_over(index):
            early = self._catch_up(index, inbox)
            told |= self._early_sums.channels()
        else:
            self._contradictions.forget_early()
        self._fits.common.add(index, (newest, early))
        self._contradictions.step(index)
        if not self.doubts():
            sure = self._in_use.known if self._fits.is_sure(self._in_use.version) else None
            self._legacy.note_poses(self._in_use.poses, sure)
        told["load_change"] = np.array([float(self._memory.changed_at)])
        return told | self._floods.channels()

    def fits(self, channels: Mapping[str, Array]) -> bool:
        """Whether what a neighbour sent has the shapes of this team."""
        return self._floods.fit(channels) and self._sums.fit(channels) and self._early_sums.fit(channels)

    @property
    def total_wrench(self) -> Array:
        """Total wrench (6,) about the origin of ``F_i`` at the last sample of ``total_block``."""
        pose, wrench = self._total
        return pose.inverse().adjoint() @ wrench

    @property
    def poses(self) -> dict[str, Pose]:
        """Of all members, in the body frame."""
        return dict(zip(self._names, self._in_use.poses, strict=True))

    def poses_to_keep(self) -> dict[str, KnownPose] | None:
        """Of all members, in the body frame, for the next team; None if they cannot be relied upon."""
        is_doubtful = self._contradictions.suspect is not None or self._in_use.may_be_spoilt
        kept = self._legacy.poses(None if is_doubtful else self._in_use.poses)
        return None if kept is None else dict(zip(self._names, kept, strict=True))

    @property
    def _is_settled(self) -> bool:
        """Whether what is remembered of the load is seen with the poses in use, and nothing may have spoilt these."""
        return self._corrected == self._in_use.version and not self._in_use.may_be_spoilt

    def known_load(self) -> KnownLoad | None:
        """What the load is in the body frame, for the next team; None if that never was known of the present one."""
        if self._contradictions.suspect is None:
            self._note_load()
        return self._legacy.load(self._memory.changed_at)

    def _note_load(self) -> None:
        self._legacy.note_load(self._memory.known_load() if self._is_settled else None, self._memory.changed_at)

    def found(self) -> Found | None:
        """What is known of poses and load; None as long as no poses have been fitted.

        While a fit is under way that matters, what was known before: motions are seen with new poses then, wrenches
        with old ones. The first one matters: before, nobody knows what poses do to the wrenches.
        """
        known, changed_at = self._in_use.known, self._memory.changed_at
        is_settled = self._corrected == self._in_use.version
        if known is not None and (is_settled or (self._corrected > 0 and self._largest_step < _LITTLE)):
            payload, unseen = self._memory.payload(self._own, known)
            neighbours = self._in_use.neighbours(self._neighbours)
            return Found(neighbours, payload, unseen, changed_at, self._completeness.newest)
        if self._found_before is not None and self._found_before.changed_at != changed_at:
            return replace(self._found_before, payload=None)  # that was another load
        return self._found_before

    def doubts(self) -> tuple[str, ...]:
        """Why what is known of the load may not be true any more."""
        if self._completeness.newest < 0:
            return ("the team's sums have just begun",)
        if self._contradictions.doubt is not None:
            return (self._contradictions.doubt,)
        gap = self._completeness.gap(self._next)
        if gap is not None:
            return (gap,)
        if self._in_use.known is not None and (self._in_use.may_be_spoilt or self._memory.is_spoilt):
            return (STILL_FOUND,)
        recent_gap = self._completeness.recent_gap
        return () if recent_gap is None else (recent_gap,)

    @property
    def must_start_over(self) -> bool:
        """Whether this robot's measurements have contradicted the team's motion for too long, or fits are stuck.

        Where poses in use may be spoilt, contradictions may be theirs: everybody is blamed in turn, and there are no
        samples to fit them anew to. Then it is up to the one that is blamed now; the others go on with better poses.
        """
        is_own_turn = self._in_use.may_be_spoilt and self._contradictions.is_own_turn
        return self._contradictions.have_lasted or is_own_turn or self._fits.are_stuck

    def _look_for_contradictions(self, index: int) -> None:
        """When there is one, what was learned while it went unnoticed does not count."""
        was, self._is_contradicted = self._is_contradicted, self._contradictions.suspect is not None
        if self._is_contradicted and not was:
            self._held.drop()
            self._memory.forget_late(UNNOTICED)
            self._note_load()
            if not self._early_sums.are_over(index - self._config.blocks(UNNOTICED)):
                self._memory.forget_early(PACE * UNNOTICED)
            self._early_sums.end()
            if self._in_use.version == 0 and self._in_use.known is not None:
                # Poses from a former team may be what contradicts: they are found again, as if nobody had known more.
                self._in_use.forget_how_well(WELL_KNOWN)
                self._largest_step = np.inf
                self._memory.expect_anything()

    # --- sums ---

    def _catch_up(self, index: int, inbox: Mapping[str, Mapping[str, Array]]) -> RegistrationMoments | None:
        """Blocks from before the start enter the sums, and others leave them."""
        pose, version = self._fits.carrying_pose(self._in_use.poses), self._fits.carried
        finished, motion = self._early_sums.step(index, pose, version, inbox), self._in_use.motion
        if finished is None or motion.needs_slope or finished[0].version != self._in_use.version:
            return None
        entered, sums = finished
        if not motion.are_plausible(sums):
            return None
        pose_moments, load = block_moments(entered.samples, motion.fusion.motion(sums), sums[:, 0])
        is_like_others = self._contradictions.add_early(pose_moments)
        misfit = block_misfit(pose_moments, self._in_use.own, self._config.noise)
        is_unlikely = not is_like_others or misfit > _UNLIKELY
        if self._in_use.known is not None and is_unlikely:
            return None
        self._memory.push_early(entered.block, load)
        return pose_moments

    def _take_in(self, entered: Entered, sums: Array, index: int) -> RegistrationMoments | None:
        """The team's sums of a block, in the body frame; returns what they say of the own pose."""
        newest = self._in_use.motion.add(entered, sums)
        if newest is None:
            return None
        self.total_block, self._total = entered.block, (entered.pose, sums[-1, 0])
        return self._look_at(newest, index)

    def _look_at(self, block: int, index: int) -> RegistrationMoments | None:
        """Learn from the sums of a block, if they can be true; returns what they say of the own pose."""
        seen = self._in_use.motion.look_at(block, self._use_poses)
        if seen is None:
            return None
        entered, sums, motion = seen
        found = Block(block, *block_moments(entered.samples, motion, sums[:, 0]))
        is_like_others = self._contradictions.add(found.pose)
        misfit = block_misfit(found.pose, self._in_use.own, self._config.noise)
        if self._is_contradicted or not is_like_others or misfit > _NONSENSE:
            self._held.drop()
            return None
        learned = None  # moments of one that was held count for nobody: others may not have waited
        for each in self._held.admit(found, self._memory.surprise(found.load)):
            learned = self._learn(each, index)
        return learned

    def _learn(self, found: Block, index: int) -> RegistrationMoments | None:
        self._completeness.note(found.number)
        changed_at = self._memory.push(found.number, found.load)
        if changed_at is not None:
            self._load_changes.notice(changed_at, index, within=self._hearing)
        return found.pose if found.number >= self._fits.again_before else None  # else it comes again

    # --- load changes ---

    def _hear_of_change(self, changed_at: Array | None, index: int) -> None:
        if changed_at is None or changed_at.shape != (1,) or changed_at[0] > index:
            return
        if self._memory.adopt(int(changed_at[0])):
            self._load_changes.notice(int(changed_at[0]), index, within=self._hearing)

    # --- poses ---

    def _fit_poses(self, index: int) -> None:
        version = self._in_use.version
        self._in_use.fit(
            index,
            is_settled=self._corrected == version,
            is_spoilt=self._is_contradicted,
            are_rough=self._memory.is_spoilt,
            come_again=not self._in_use.motion.needs_slope,
        )
        if version == 0 and self._fits.prior is None:
            self._legacy.forget_sure_poses()
        if self._fits.again_before > self._early_sums.start:
            if self._fits.may_be_spoilt(self._fits.carried):
                self._early_sums.forget()
            self._early_sums.begin(self._fits.again_before)
            self._contradictions.forget_early()
        if self._in_use.known is None or self._corrected == version:
            return
        rows = self._wrenches.rows(version)
        if rows is not None:
            self._memory.correct(rows, self._in_use.known)
            self._corrected = version

    def _use_poses(self, version: int) -> None:
        """All samples so far count from now on as if they had been carried with the poses of a version."""
        if version == self._in_use.version:
            return
        self._found_before = None if self.doubts() else self.found()
        self._held.drop()
        if self._contradictions.suspect is None:
            self._note_load()
        switch = self._in_use.switch(version)
        self._largest_step = switch.largest_step
        motion, known = self._in_use.motion, self._in_use.known
        self._memory.use_poses(switch.feature_map, switch.old, switch.new, motion.fusion)
        self._wrenches.tell(self._own, version, self._memory.told())
        comes_again = self._fits.again_before > self._counted_from
        self._counted_from = self._fits.again_before
        # What came while poses were too rough may be of several loads, whether it comes again or not.
        must_begin_again = self._memory.is_spoilt if motion.needs_slope else comes_again
        if must_begin_again and known is not None:
            self._memory.begin_again(known)
