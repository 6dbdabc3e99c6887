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
from agents.pose_fits import UNNOTICED, PoseFits, largest_step
from agents.sums import Entered, TeamSums
from agents.total_motion import TotalMotion
from agents.watch import block_misfit
from coheft.estimation.body_motion import perturbation_between
from coheft.estimation.load_comparison import KnownLoad
from coheft.estimation.observability import PoseEstimate
from coheft.estimation.registration import RegistrationMoments
from coheft.estimation.spatial import Array, Pose
from coheft.estimation.team_registration import PosePrior, refit_map, seen_from
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
        self._poses = tuple(poses[name].pose for name in self._names)
        self._fitted = known_from_before([poses[name] for name in self._names])
        schedule = choose_schedule({name: graph[name] for name in self._names})
        self._sums = TeamSums("sums", config.name, self._neighbours, schedule, config.block, config.noise)
        self._early_sums = EarlySums(config, self._neighbours, schedule, start, history)
        self._next = start
        self._hearing = hearing(graph)

        self._motion = TotalMotion(config, self._poses)
        self._legacy = Legacy()
        self._found_before: Found | None = None
        self._neighbours_poses: dict[str, PoseEstimate] = {}
        self._memory = LoadMemory(config, self._own, self._poses, self._motion.fusion, self._fitted, former)

        members = len(self._names)
        prior, deviations, settling = None, WELL_KNOWN, 0
        if self._fitted is not None:
            prior, deviations = PosePrior.of(self._fitted), self._fitted.deviations.max(axis=0)
            settling = config.blocks(UNNOTICED)
            self._neighbours_poses = seen_from(self._fitted, config.name, self._names, self._neighbours)
        self._fits = PoseFits(
            config, members, self._own, start, schedule.rounds, self._hearing, regrowth=1.0, prior=prior
        )
        # Versions of the poses that the past was mapped to, and corrected for.
        self._version = self._corrected = 0
        # The last start of the early sums that the memory knows of.
        self._counted_from = start
        self._largest_step = np.inf if self._fitted is None else 0.0
        self._wrenches = Flood(members, LoadMemory.told_size)
        self._contradictions = Contradictions(config, self._names, self._poses[self._own], deviations)
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
        self._sums.enter(self._entered(index, samples))
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
            self._legacy.note_poses(self._poses, self._fitted if self._fits.is_sure(self._version) else None)
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
        return dict(zip(self._names, self._poses, strict=True))

    def poses_to_keep(self) -> dict[str, KnownPose] | None:
        """Of all members, in the body frame, for the next team; None if they cannot be relied upon."""
        is_doubtful = self._contradictions.suspect is not None or self._fits.may_be_spoilt(self._version)
        kept = self._legacy.poses(None if is_doubtful else self._poses)
        return None if kept is None else dict(zip(self._names, kept, strict=True))

    @property
    def _is_settled(self) -> bool:
        """Whether what is remembered of the load is seen with the poses in use, and nothing may have spoilt these."""
        return self._corrected == self._version and not self._fits.may_be_spoilt(self._version)

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
        is_coherent = self._corrected == self._version or (self._corrected > 0 and self._largest_step < _LITTLE)
        if self._fitted is not None and is_coherent:
            seen = self._memory.payload(self._own, self._fitted)
            return Found(self._neighbours_poses, *seen, self._completeness.newest)
        if self._found_before is not None and self._memory.changed_at > self._found_before.payload_block:
            return replace(self._found_before, payload=None)
        return self._found_before

    def doubts(self) -> tuple[str, ...]:
        """Why what is known of the load may not be true any more."""
        if self._completeness.newest < 0:
            return ("the team's sums have just begun",)
        suspect = self._contradictions.suspect
        if suspect is not None:
            return (f"what {suspect} measures contradicts how the load moves",)
        gap = self._completeness.gap(self._next)
        if gap is not None:
            return (gap,)
        if self._fitted is not None and (self._fits.may_be_spoilt(self._version) or self._memory.is_spoilt):
            return ("the poses are still being found",)
        recent_gap = self._completeness.recent_gap
        return () if recent_gap is None else (recent_gap,)

    @property
    def must_start_over(self) -> bool:
        """Whether this robot's measurements have contradicted the team's motion for too long, or fits are stuck.

        Where poses in use may be spoilt, contradictions may be theirs: everybody is blamed in turn, and there are no
        samples to fit them anew to. Then it is up to the one that is blamed now; the others go on with better poses.
        """
        is_own_turn = self._fits.may_be_spoilt(self._version) and self._contradictions.is_own_turn
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
            if self._version == 0 and self._fitted is not None:
                self._forget_what_was_known()

    def _forget_what_was_known(self) -> None:
        """Poses from a former team may be what contradicts: they are to be found again, as if nobody had known more."""
        self._fits.forget_prior()
        self._fitted = None
        self._neighbours_poses, self._largest_step = {}, np.inf
        self._contradictions.use_pose(self._poses[self._own], WELL_KNOWN)
        self._memory.expect_anything()

    # --- sums ---

    def _entered(self, block: int, samples: Array | None) -> Entered | None:
        if samples is None:
            return None
        return Entered(block, samples, self._fits.carrying_pose(self._poses), self._fits.carried)

    def _catch_up(self, index: int, inbox: Mapping[str, Mapping[str, Array]]) -> RegistrationMoments | None:
        """Blocks from before the start enter the sums, and others leave them."""
        pose, version = self._fits.carrying_pose(self._poses), self._fits.carried
        finished = self._early_sums.step(index, pose, version, inbox)
        if finished is None or self._motion.needs_slope or finished[0].version != self._version:
            return None
        entered, sums = finished
        if not self._motion.are_plausible(sums):
            return None
        pose_moments, load = block_moments(entered.samples, self._motion.fusion.motion(sums), sums[:, 0])
        is_like_others = self._contradictions.add_early(pose_moments)
        misfit = block_misfit(pose_moments, self._poses[self._own], self._config.noise)
        is_unlikely = not is_like_others or misfit > _UNLIKELY
        if self._fitted is not None and is_unlikely:
            return None
        self._memory.push_early(entered.block, load)
        return pose_moments

    def _take_in(self, entered: Entered, sums: Array, index: int) -> RegistrationMoments | None:
        """The team's sums of a block, in the body frame; returns what they say of the own pose."""
        newest = self._motion.add(entered, sums)
        if newest is None:
            return None
        self.total_block, self._total = entered.block, (entered.pose, sums[-1, 0])
        return self._look_at(newest, index)

    def _look_at(self, block: int, index: int) -> RegistrationMoments | None:
        """Learn from the sums of a block, if they can be true; returns what they say of the own pose."""
        seen = self._motion.look_at(block, self._use_poses)
        if seen is None:
            return None
        entered, sums, motion = seen
        found = Block(block, *block_moments(entered.samples, motion, sums[:, 0]))
        is_like_others = self._contradictions.add(found.pose)
        misfit = block_misfit(found.pose, self._poses[self._own], self._config.noise)
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
        self._fits.step(
            index,
            self._version,
            self._poses,
            self._motion.slope,
            is_settled=self._corrected == self._version,
            is_spoilt=self._is_contradicted,
            are_rough=self._memory.is_spoilt,
            come_again=not self._motion.needs_slope,
        )
        if self._version == 0 and self._fits.prior is None:
            self._legacy.forget_sure_poses()
        if self._fits.again_before > self._early_sums.start:
            if self._fits.may_be_spoilt(self._fits.carried):
                self._early_sums.forget()
            self._early_sums.begin(self._fits.again_before)
            self._contradictions.forget_early()
        if self._fitted is None or self._corrected == self._version:
            return
        rows = self._wrenches.rows(self._version)
        if rows is not None:
            self._memory.correct(rows, self._fitted)
            self._corrected = self._version

    def _use_poses(self, version: int) -> None:
        """All samples so far count from now on as if they had been carried with the poses of a version."""
        if version == self._version:
            return
        self._found_before = None if self.doubts() else self.found()
        self._held.drop()
        if self._contradictions.suspect is None:
            self._note_load()
        poses = self._fits.take_poses(version)
        self._motion.set_poses(poses)
        feature_map = refit_map(self._poses, poses, self._config.noise, self._motion.slope)
        self._fits.map(feature_map)
        self._contradictions.map(feature_map)
        self._memory.use_poses(feature_map, self._poses, poses, self._motion.fusion)
        steps = [perturbation_between(old, new) for old, new in zip(self._poses, poses, strict=True)]
        self._poses, self._version = poses, version
        self._fitted = self._fits.known(poses, steps, self._motion.slope)
        self._contradictions.use_pose(poses[self._own], self._fitted.deviations.max(axis=0))
        self._neighbours_poses = seen_from(self._fitted, self._config.name, self._names, self._neighbours)
        self._largest_step = largest_step(self._fitted, steps)
        self._wrenches.tell(self._own, version, self._memory.told())
        comes_again = self._fits.again_before > self._counted_from
        self._counted_from = self._fits.again_before
        # What came while poses were too rough may be of several loads, whether it comes again or not.
        must_begin_again = self._memory.is_spoilt if self._motion.needs_slope else comes_again
        if must_begin_again:
            self._memory.begin_again(self._fitted)
