"""What a robot remembers of the load: moments of the team's total wrench with the body's motion, in the body frame."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from agents.disturbance import Disturbance, Uncorrected
from agents.early_blocks import EarlyBlocks
from agents.late_wrenches import LateWrenches
from agents.load_moments import CROSS_SHAPE, disturbed, gram_map, mapped, number_of_samples, sum_of_squares
from agents.load_weights import LoadWeights
from agents.make_memory import make_memory
from agents.mean_square import MeanSquare
from agents.seen_payload import SeenPayload, StandingPayload, seen_payload
from agents.wrench_correction import (
    TOLD_SIZE,
    WrenchCorrection,
    motion_grams,
    told_forces,
    told_start,
    told_wrenches_by_motion,
)
from coheft.estimation.inertia import FEATURES, GRAM_SIZE
from coheft.estimation.load_comparison import KnownLoad, maybe_former
from coheft.estimation.motion_fusion import MotionFusion
from coheft.estimation.spatial import Array, Pose
from coheft.estimation.team_registration import TeamPoses
from coheft.wire.config import AgentConfig

_OTHER_LOAD = 3.0
"""An early block with such a mean square of its residuals over what it should be, and all before it, are of another."""
_KNOWN = 0.8
"""From samples over so long the load is known well enough to tell; before, tests between samples have to do [s]."""
_NEW = 0.5
"""A load is so much less certain, in variance, as the square of this over the time of its samples: in few samples the
motions' noise is not what it is on average [s]."""
_LEAST = 0.3
"""Least time of samples from which anything is estimated [s]."""
_MISFIT = "load: the forces of late do not fit what is remembered of it"
_MAY_BE_FORMER = "load: whether it has changed, or a sensor of its wrench is off; shake and turn it"


class LoadMemory:
    """All samples since the load changed, as one agent remembers them.

    Args:
        config: The agent's settings.
        own: Index of this robot.
        poses: Of all robots, in the body frame.
        fusion: Of their motion sensors, at these poses.
        known: How well these poses are known, None if nobody knows.
        former: What a former team knew of the load: whether it still is that one has to show.
    """

    told_size = TOLD_SIZE
    """Numbers of ``told``."""

    def __init__(
        self,
        config: AgentConfig,
        own: int,
        poses: Sequence[Pose],
        fusion: MotionFusion,
        known: TeamPoses | None = None,
        former: KnownLoad | None = None,
    ) -> None:
        self._config = config
        self._window = make_memory(config, own, len(poses))
        if former is not None and not config.efficient.offsets:
            self._window.expect(former)
        # Whether neighbours and observers know of the change that made the load doubtful.
        self._is_change_told = False
        self._last_block = self._changed_at = -1
        self._early = EarlyBlocks()
        # Whether the samples of the correction under way were forgotten, to come again.
        self._comes_again = False
        self._correction: WrenchCorrection | None = None
        self._uncorrected = Uncorrected()
        self._forces = MeanSquare()
        self._wrenches_by_motion = np.zeros((len(poses), *CROSS_SHAPE))
        self._disturbance = Disturbance(config.rate)
        self._weights = LoadWeights(config, poses, fusion, self._disturbance)
        self._late = LateWrenches(config.rate / config.block)
        self._known = known
        self._standing = StandingPayload()

    @property
    def changed_at(self) -> int:
        """First block with the present load, -1 if it has not changed yet."""
        return self._changed_at

    def known_load(self) -> KnownLoad | None:
        """What the load is in the body frame, or was when that was clear last; None if it is not known."""
        if self._window.former is not None:
            return self._window.former
        is_known = self._is_enough() and not self._disturbance.is_spoiling and not self._late.contradict
        return self._window.known_load(self._weights.model) if is_known else None

    @property
    def is_spoilt(self) -> bool:
        """Whether poses are so rough that a change of the load would not be seen."""
        return self._disturbance.is_spoiling

    def push(self, block: int, moments: Array) -> int | None:
        """Take in a block: its number, and what is summed of it (190 + riders,), see ``agents.load_moments``.

        Returns:
            The first block of a new load, if a change was found that is news: not while it is not clear whether the
            one before was of the load.
        """
        self._window.push(block, moments)
        if self._correction is None:  # else they wait for its end: they were carried with the new poses already
            self._early.move_to(self._window)
        self._forces.add(sum_of_squares(moments), number_of_samples(moments))
        self._use_known_poses()
        self._last_block = block
        self._uncorrected.age(self._window.kept)
        if self._correction is not None:
            self._correction.age(self._window.kept, moments)
        if self._disturbance.is_spoiling:
            self._window.forget_borders_before(block)  # later, too, these samples cannot be told apart by their load
            self._look_back(block, moments)
            return None
        # Until ``correct`` the poses' last step adds up in all samples from before it.
        is_coherent = self._correction is not None
        if self._is_enough() and self._weights.are_due(self.count):
            self._weights.learn(self._window)
        self._is_change_told &= self._window.former is not None
        is_told = self._is_change_told
        change = self._window.review(self._weights.model, is_coherent) if self._weights.know_load else None
        if change is None:
            self._look_back(block, moments)
            return None
        self._begin(change)
        self._is_change_told = True
        return None if is_told else change

    def _use_known_poses(self) -> None:
        """Expect what they do, from the first block on and again when there are enough, if others feel as much."""
        if self._known is not None and (self._is_enough() or self._disturbance.size == np.inf):
            self._expect_disturbance(np.zeros(len(self._known.poses)), self._known)
            self._known = None if self._is_enough() else self._known

    def expect_anything(self) -> None:
        """It is not known any more how well poses are known."""
        self._known = None
        self._disturbance.forget()

    def surprise(self, moments: Array) -> float:
        """Mean square of a block's residuals over what it should be, by what is known of the load; 0 if nothing is."""
        return self._surprise(moments) / (1.0 + self._disturbance.size)

    def _surprise(self, moments: Array) -> float:
        """The same in units of the noise."""
        return self._late.surprise(self._weights.model, moments[:GRAM_SIZE])

    def _look_back(self, block: int, moments: Array) -> None:
        """Hold the wrenches of late against what is remembered; if they do not fit for long, forget it."""
        self._late.add(moments[:FEATURES])  # the Gram matrix's first row
        if self._correction is not None:
            return  # motions are seen with new poses, wrenches with old ones
        self._compare(is_new=self._late.need_solution(self._growing_count))
        if self._late.have_long_contradicted:
            count = self.count
            self._forget_before(block)
            self._window.reconsider()
            if self.count < count:  # else it fades, and the forces of late will do so for a while
                self._begin(self._changed_at)

    def _compare(self, is_new: bool) -> None:
        if not self._is_enough():
            self._late.forget_solution()
            return
        if is_new:
            self._late.solve(self._weights.model, self._window.information(self._weights.model))
        self._late.compare(self._weights.model, self._disturbance.covariance)

    def _begin(self, changed_at: int) -> None:
        """What is remembered is of another load than before."""
        self._early.drop()
        self._changed_at = changed_at
        self._uncorrected.begin()
        self._standing.drop()
        self._late.begin()
        self._weights.begin()
        self._forces = MeanSquare()

    def push_early(self, block: int, moments: Array) -> None:
        """Take in what is from before all others, as ``push``, unless it is of another load.

        It counts from the next ``push`` on.
        """
        is_known = self.count >= _KNOWN * self._config.rate
        expected = _OTHER_LOAD * (1.0 + self._disturbance.per_sample)
        is_surprise = is_known and self._surprise(moments) > expected
        if block < self._changed_at or is_surprise:
            self._early.close()
        self._early.add(block, moments)

    def adopt(self, changed_at: int) -> bool:
        """A neighbour says that the load changed at this block. Returns whether that is news, as ``push``."""
        if changed_at <= self._changed_at:
            return False
        is_told = self._is_change_told and self._window.former is not None
        self._begin(changed_at)
        if self._disturbance.is_spoiling:  # what samples say of the load before is worth nothing
            self._window.forget_before(changed_at)
        else:
            self._window.accept(changed_at, self._weights.model)
        self._is_change_told = True
        return not is_told

    def forget_late(self, duration: float) -> None:
        """What came in the last so many seconds does not count, nor what has come early since then."""
        self._early.drop()
        self._window.forget_since(self._last_block - self._config.blocks(duration))
        self._late.begin()
        self._have_forgotten()

    def forget_early(self, duration: float) -> None:
        """What came in the last so many seconds of what was before all others does not count."""
        if self._early.first >= 0:
            self._forget_before(self._early.first + self._config.blocks(duration))

    def _forget_before(self, block: int) -> None:
        """Blocks with smaller numbers do not count; what comes of them yet is not known to be of the same load."""
        self._window.forget_before(block)
        self._early.end()
        self._have_forgotten()

    def _have_forgotten(self) -> None:
        """What has been told of the samples is not of those that are left."""
        self._uncorrected.begin()
        self._standing.drop()
        if self._correction is not None:
            self._window.forget_before(self._last_block + 1)
            self._correction = None

    @property
    def count(self) -> float:
        """Number of samples that count."""
        return number_of_samples(self._window.total)

    @property
    def _growing_count(self) -> float:
        """The same where samples are what they were as long as there are about as many; else not a number."""
        return np.nan if self._window.kept < 1.0 else self.count

    def told(self) -> Array:
        """What everybody has to know of the samples so far, see ``WrenchCorrection.told``."""
        assert self._correction is not None
        return self._correction.told(self._forces.mean)

    def correct(self, rows: Array, team: TeamPoses) -> None:
        """Let the total wrenches be as the newest poses would have carried them, if everybody tells of the same load.

        Args:
            rows: Everybody's ``told``, shape (N, 83).
            team: The newest poses.
        """
        correction, self._correction = self._correction, None
        self._known = None
        self._standing.drop()
        if correction is None:  # what it was to correct is forgotten
            self._expect_disturbance(told_forces(rows), team)
            return
        told = rows if correction.is_possible(rows, self._changed_at) else None
        if told is not None:
            self._wrenches_by_motion = told_wrenches_by_motion(told)
        if not self._comes_again:
            self._apply(correction, told)
        before = self._disturbance.per_sample
        self._expect_disturbance(told_forces(rows), team)
        less = before - self._disturbance.per_sample
        if less > 0.0 and not self._comes_again:
            left = less * (1.0 if told is None else correction.left(told))
            self._window.revise(lambda sums: disturbed(sums, left))
        self._compare(is_new=True)  # what was told may have been nonsense

    def _apply(self, correction: WrenchCorrection, rows: Array | None) -> None:
        size = self._disturbance.per_sample
        count = max(0.0, self.count - correction.count_since)
        if rows is None:
            self._window.forget_borders_before(correction.last_block + 1)
            self._uncorrected.correct(count, count, size)
        else:
            self._window.revise(lambda sums: correction.apply(sums, self._wrenches_by_motion))
            self._uncorrected.correct(count, correction.mean_lack(rows), size)
            self._forget_start(told_start(rows))
        if self._disturbance.is_rough and (rows is None or not correction.is_exact(rows)):
            self._forget_before(correction.last_block + 1)  # with such poses, what is lacked is too much

    def _forget_start(self, block: int) -> None:
        """What came before a block, some robot's first one, does not count, if that is the smaller part of all.

        How that robot's wrench followed from the motion then is not known.
        """
        first, count = self._window.first_block, self.count
        if first < block <= (first + self._last_block) // 2:
            self._window.forget_before(block)
            self._uncorrected.age(self.count / count)
            self._early.end()

    def _expect_disturbance(self, forces: Array, team: TeamPoses) -> None:
        """From now on samples are spoilt by what poses do to everybody's mean square forces (N,) [N²].

        Who has not felt any yet counts as if it pushed as hard as this robot; if nobody has, nothing is known.
        """
        forces = np.where(forces > 0.0, forces, self._forces.mean)
        if forces.all():
            self._weights.expect_disturbance(forces, team)

    def use_poses(
        self, feature_map: Array, old_poses: Sequence[Pose], new_poses: Sequence[Pose], fusion: MotionFusion
    ) -> None:
        """See all that is remembered, and what comes, with new poses; wrenches follow with ``correct``.

        Args:
            feature_map: What fusing motions with the new poses makes of the samples, ``refit_map`` (28, 28).
            old_poses: Of all robots, in use so far.
            new_poses: From now on.
            fusion: Of motion sensors at these.
        """
        self._early.move_to(self._window)
        to_new = gram_map(feature_map)
        self._window.revise(lambda sums: mapped(sums, to_new))
        self._late.map(to_new)
        self._correction = WrenchCorrection(
            self._window.total, self._changed_at, self._window.first_block, self._last_block, old_poses, new_poses
        )
        self._comes_again = False
        self._weights.set_poses(new_poses, fusion, self._window if self._is_enough() else None)

    def begin_again(self, team: TeamPoses) -> None:
        """The samples of late come again, carried with poses that are known as said: forget all.

        A memory that fades keeps what it has, to be corrected, and takes nothing early.
        """
        self._window.forget_before(self._last_block + 1)
        self._comes_again = self.count == 0.0
        self._early.begin()
        if self._comes_again:
            self._uncorrected.begin()
            self._late.begin()
            self._expect_disturbance(np.zeros(len(team.poses)), team)

    def payload(self, own: int, team: TeamPoses) -> SeenPayload:
        """Mass properties in ``F_i`` with their covariance, that of all poses included; and what is not observable.

        As long as nobody can tell whether the load has changed, the covariance counts with both.
        """
        if not self._is_enough():
            return SeenPayload(None, ())
        if self._late.contradict:
            return SeenPayload(None, (_MISFIT,))
        return self._standing.find(
            count=self._growing_count,
            objects=(team, self._weights.model, self._wrenches_by_motion, self._window.former),
            numbers=(own, self._window.doubt, self._window.first_block, self._disturbance.size),
            solve=lambda: self._solve(own, team),
        )

    def _solve(self, own: int, team: TeamPoses) -> SeenPayload:
        model, sums = self._weights.model, self._window.total
        information = self._window.information(model)
        by_poses = self._uncorrected.of_parameters(self._disturbance, model, information, sums[:GRAM_SIZE])
        crosses = motion_grams(sums) @ self._wrenches_by_motion
        estimate, sensitivity = self._weights.estimate(information, sums, crosses, by_poses, team)
        former = self._window.former
        if former is not None:
            estimate = maybe_former(estimate, former)
        inflation = self._window.doubt * (1.0 + (_NEW * self._config.rate / self.count) ** 2)
        payload, unseen = seen_payload(estimate, sensitivity, own, team, inflation, self._weights.size)
        return SeenPayload(payload, unseen if former is None else (*unseen, _MAY_BE_FORMER))

    def _is_enough(self) -> bool:
        return self.count >= _LEAST * self._config.rate
