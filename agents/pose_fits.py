"""When and how a team fits its poses anew: scores told, a joint step by the reference robot, and a common switch.

1. *tell*: at blocks that all agents know, each tells its score over the samples that all have;
2. *fit*: when it has heard all, the reference robot computes the joint step, and tells all poses and the block from
   which they count. Anybody could, but not everybody need be of the same opinion on the poses, where messages were
   lost, and must not be of another one for that;
3. *switch*: from that block on samples that enter the sums are carried with the new poses, and bear their version. If
   the poses before were too rough, or nobody knows, all samples from before are left out, or go through sums again
   (``agents.early_sums``).

Every step waits for what it needs, however long that takes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from agents.common_moments import CommonMoments
from agents.noise_judge import NoiseJudge
from agents.pose_rows import FIT_SIZE, SCORE_SIZE, Fit, Scores, score_row
from coheft.estimation.body_motion import perturbation_between
from coheft.estimation.registration import RegistrationMoments, least_squares, score_and_information
from coheft.estimation.spatial import Array, Pose
from coheft.estimation.team_registration import (
    PosePrior,
    TeamPoses,
    fitted_poses,
    register_team,
    residual_shares,
)
from coheft.wire.config import AgentConfig
from consensus.flood import Flood

_SHORTEST_ROUND = 0.2
"""Shortest time between two fits of the poses [s]."""
_SELDOM = 5.0
"""Longest time between them, however old the team is: only a fit shows that a sensor is off by little [s]."""
_FIRST = 0.4
"""Time of samples for the first one [s]."""
UNNOTICED = 0.5
"""What contradicts the team's motion is noticed within this time [s]."""
_CHUNK = 0.1
"""Robots tell each other every so often, or when all have been heard, which blocks they have [s]."""
_WORST = 25.0
"""Mean square of the residuals, in units of the noise, beyond which poses are not called more uncertain: then sensors
contradict the team's motion."""
_SOON = 1.0
"""After poses that may be spoilt, samples over so long are enough, however many were left out [s]."""
_STUCK = 1.0
"""When poses have been told for so long and are not in use, they never will be [s]; nor will robots agree on which
samples they have when they could not for so long, and sums were complete."""
_IN_VAIN = 3
"""Scores that were told so many times in a row without a fit never lead to one."""
_FAR = np.radians(2.0)
"""When a fit turns a pose by more, how samples seen with the old poses would look with the new ones is not known well
enough [rad]."""
_FAR_SHIFT = 0.05
"""The same for a shift [m]: what velocities say of ``w`` was wrong then, and so were the products of ``w``."""
_FAR_IN_DEVIATIONS = 15.0
"""A shift by less, in deviations of the new pose, is not far: then what was wrong with products of ``w`` is below the
noise."""
_LEFT = 0.25
"""Share of a fit's last step that may be left to go, because the fit is not linear."""
STILL_FOUND = "the poses are still being found"
UNTRIED = 1.5
"""Poses are so much less certain, in variance, as the square of this over the time of samples that they were fitted to
[s]: what is left out of their covariance is of second order, and matters when they are new."""


class PoseFits:
    """One robot's part in the fits.

    Args:
        config: The agent's settings.
        robots: Number of robots.
        own: Index of this one; the first is the reference robot.
        start: Block at which the sums begin.
        under_way: Blocks from a sample's entering the sums to its leaving them.
        hearing: Blocks until everybody has heard everybody.
        regrowth: When samples were left out, or come again, so many times as many are waited for.
        prior: What is known of the poses from a former team.

    Attributes:
        prior: The same, None once samples have contradicted it, see ``forget_prior``.
        common: Moments over the samples that all have.
        told_moments: The same as they were when the own score was told last.
        carried: Version of the poses that samples are carried with now, 0 at the start.
        again_before: Samples from before this block do not count, unless they go through sums again, with these poses.
        spoilt: Poses of versions up to this one were fitted to samples that something may have spoilt, -1 if none.
        floods: What is told to neighbours and heard from them, by name.
    """

    def __init__(
        self,
        config: AgentConfig,
        robots: int,
        own: int,
        start: int,
        under_way: int,
        hearing: int,
        regrowth: float,
        prior: PosePrior | None = None,
    ) -> None:
        self._config = config
        self.prior = prior
        self._own = own
        self._hearing = hearing
        self._shortest = config.blocks(_SHORTEST_ROUND)
        self._round_takes = 3 * hearing + under_way + 3
        self._tells = self._tell_step = 0  # the first fit comes as soon as there are samples enough
        chunk = max(config.blocks(_CHUNK), 2 * hearing)
        self._unsure = -(-config.blocks(UNNOTICED) // chunk) + 1
        self.common = CommonMoments(robots, own, start, chunk, parts=2, unsure=self._unsure)
        self._scores = Flood(robots, SCORE_SIZE)
        self._fits = Flood(robots, FIT_SIZE)
        self.floods = {"common": self.common.flood, "scores": self._scores, "fits": self._fits}
        self.told_moments = RegistrationMoments.none()
        self.carried, self.spoilt, self._told_chunk, self._used = 0, -1, 0, 0
        self._told_count = -1.0
        self.again_before = start
        self._regrowth = regrowth
        self._patience, self._uncarried = config.blocks(_STUCK) + 2 * hearing, 0
        self._noise_judge = NoiseJudge()
        self._told_poses: dict[int, tuple[Pose, ...]] = {}
        self._chunks: dict[int, int] = {}

    def step(
        self,
        index: int,
        version: int,
        poses: Sequence[Pose],
        slope: Array,
        is_settled: bool,
        is_spoilt: bool,
        are_rough: bool,
        come_again: bool,
    ) -> None:
        """Whatever is due at a block.

        Args:
            index: Its number.
            version: Of the poses in use.
            poses: In use.
            slope: What the gyros' slope says about ``(a, alpha)``, shape (6, 6), where motions are found with it.
            is_settled: Whether everything accumulated is seen with these poses.
            is_spoilt: Whether something contradicts the team's motion.
            are_rough: Whether the poses in use are, or may be, too rough to weigh with.
            come_again: Whether samples that poses were too rough for can be left out, or go through sums again.
        """
        if is_spoilt:
            self.common.spoil(index - 1)
        while self.common.agree(index - 1):
            if self.common.is_spoilt:
                self._look_at_spoilt()
            if self.common.has_forgotten:  # fits pay again as they do at first, however old the team is
                self._tell_step = min(self._tell_step, self.common.steps + self._round_takes)
            self._tell_score(version, poses, is_settled and self.carried == version)
        if self._own == 0:
            self._fit(index, version, poses, slope, are_rough, come_again)
        told_version, _ = self._fits.row(0)
        rows = self._fits.rows(told_version) if told_version > self.carried else None
        self._uncarried = 0 if self._fits.newest <= self.carried else self._uncarried + 1
        if rows is None:
            return
        fit = Fit.of(rows)
        if index >= fit.since and fit.is_possible:
            self._switch(told_version, fit)

    def _switch(self, version: int, fit: Fit) -> None:
        """From now on samples that enter the sums are carried with the poses of a fit."""
        self._told_poses[version], self.carried = fit.poses, version
        if self.prior is not None and not fit.has_prior:
            self.forget_prior()
        if fit.are_noisy:
            self.spoilt = max(self.spoilt, version)
        if fit.again_before > self.again_before:
            self.again_before = int(fit.again_before)
            self.common.begin_again(self.again_before)

    def forget_prior(self) -> None:
        """What a former team knew of the poses is wrong, and so may be the poses that this team has begun with."""
        self.prior, self.spoilt = None, max(self.spoilt, 0)

    def may_be_spoilt(self, version: int) -> bool:
        """Whether something may have spoilt the samples that poses of a version were fitted to."""
        return version <= self.spoilt

    @property
    def are_stuck(self) -> bool:
        """Whether poses have been told that cannot be used, or from a block on that does not come; or none will be.

        One number that somebody has got wrong in a table is enough for that.
        """
        is_vain = self._tells - self.carried > _IN_VAIN
        return is_vain or max(self._uncarried, self.common.left_out) > self._patience

    def carrying_pose(self, poses: Sequence[Pose]) -> Pose:
        """Own pose to carry samples with; ``poses`` are those in use."""
        return self._told_poses.get(self.carried, tuple(poses))[self._own]

    def take_poses(self, version: int) -> tuple[Pose, ...]:
        """The poses of a version that has come into use; it and older ones are forgotten."""
        poses, self._used = self._told_poses[version], version
        self._told_poses = {number: each for number, each in self._told_poses.items() if number > version}
        self._chunks = {number: each for number, each in self._chunks.items() if number >= version}
        if len(np.unique(self._used_scores().counts)) > 1:  # not everybody had the same samples: nothing was fitted
            self.spoilt = version
        return poses

    def _used_scores(self) -> Scores:
        """What robots told for the poses in use; who could not tell is left out."""
        table = self._scores.table
        return Scores.of(table[table[:, 0] == self._used, 1:])

    def known(self, poses: Sequence[Pose], steps: Sequence[Array], slope: Array, untried: float = UNTRIED) -> TeamPoses:
        """How well poses are known that have just come into use: by the samples that they were fitted to.

        Args:
            poses: In the body frame.
            steps: How far each one's last fit has moved it, a perturbation (6,) each.
            slope: As of ``step``.
            untried: Time of samples up to which they are much less certain [s].
        """
        left = _LEFT * np.concatenate(steps)
        inflation = self._inflation(untried)
        prior = self.prior and self.prior.scaled(inflation)  # what was known before is not to be less certain below
        fitted = fitted_poses(poses, self.told_moments, self._config.noise, slope=slope, prior=prior)
        # Birge (1932): as residuals are larger than noise explains, so may be errors.
        inflation *= min(self._used_scores().squares.max(initial=1.0), _WORST)
        return replace(fitted, covariance=inflation * fitted.covariance + np.outer(left, left))

    def _inflation(self, untried: float = UNTRIED) -> float:
        """How many times less certain, in variance, poses are than the samples say that they are fitted to."""
        return float(1.0 + (untried * self._config.rate / max(self.told_moments.count, 1.0)) ** 2)

    def is_sure(self, version: int) -> bool:
        """Whether nothing can have been wrong, unnoticed, with the samples that poses in use were fitted to."""
        if version == 0:
            return self.prior is not None
        chunk = self._chunks.get(version, self.common.chunks)  # a version that nobody has told scores for is not
        return not self.may_be_spoilt(version) and self.common.chunks - chunk >= self._unsure

    def map(self, feature_map: Array) -> None:
        """All samples' features are ``feature_map`` (28, 28) times what they were."""
        self.common.map(feature_map)
        self.told_moments = self.told_moments.mapped(feature_map)

    def _tell_score(self, version: int, poses: Sequence[Pose], can_tell: bool) -> None:
        """A chunk of steps has been agreed upon: if it is time, tell the own score at the poses in use.

        When it is time depends on the agreed steps only: everybody tells of the same samples.
        """
        steps, least = self.common.steps, self._regrowth * self.common.forgotten
        if self.spoilt == self._tells:
            least = min(least, _SOON * self._config.rate)
        least = max(least, _FIRST * self._config.rate)
        count = self.common.total.count
        has_news = count != self._told_count  # none while no sum is complete
        if steps < self._tell_step or count < least or not has_news:
            return
        self._tells, self._told_chunk, self._told_count = self._tells + 1, self.common.chunks, count
        self._chunks[self._tells] = self.common.chunks
        grown = min(round(self._config.efficient.refit_share * steps), self._config.blocks(_SELDOM))
        self._tell_step = steps + max(self._round_takes, self._shortest, grown)
        if can_tell:
            moments = self.common.total
            score, information, cost = score_and_information(moments, poses[self._own], self._config.noise)
            share = residual_shares(poses, self._config.noise)[self._own]
            square = least_squares(score, information, cost) / (9.0 * share * max(moments.count, 1.0))
            self._scores.tell(self._own, self._tells, score_row(version, square, moments.count, score))
            self.told_moments = moments

    def _look_at_spoilt(self) -> None:
        """The samples of late do not count any more: poses that were fitted to them have to be fitted again, soon."""
        if self.common.chunks - self._told_chunk <= self._unsure:
            self.spoilt = self._tells
            self._tell_step = min(self._tell_step, self.common.steps + self._round_takes)

    def _fit(
        self, index: int, version: int, poses: Sequence[Pose], slope: Array, are_rough: bool, come_again: bool
    ) -> None:
        """As the reference robot: all poses after the joint step, once everybody's score at those in use is known."""
        told_version, _ = self._fits.row(0)
        if self._tells <= self.carried or max(told_version, 0) != version:
            return
        rows = self._scores.rows(self._tells)
        if rows is None:
            return
        told = Scores.of(rows)
        if np.any(told.versions != version):
            return
        since = index + self._hearing
        if np.all(told.counts == self.told_moments.count):
            prior = self._prior_that_fits(poses, told.scores, slope)
            registered = register_team(
                poses, told.scores, self.told_moments, self._config.noise, slope=slope, prior=prior
            )
            fitted, is_far = registered.poses, _is_far(poses, registered)
            are_rough |= prior is None and self.prior is not None
            are_noisy = come_again and self._noise_judge.must_leave_out(
                float(told.squares.max()), self.told_moments.count, are_rough=version == 0
            )
            if are_noisy:
                fitted = tuple(poses)  # nothing is to be learned from such samples
            are_far = are_rough or are_noisy or is_far
            again_before = since if are_far and come_again else self.again_before
        else:  # somebody has it wrong which samples all have: begin anew
            fitted, again_before, prior, are_noisy = tuple(poses), since, None, False
        fit = Fit(since, again_before, prior is not None, are_noisy, fitted)
        for robot, row in enumerate(fit.rows()):
            self._fits.tell(robot, self._tells, row)

    def _prior_that_fits(self, poses: Sequence[Pose], scores: Array, slope: Array) -> PosePrior | None:
        """What was known of poses before, in weights of the samples; None if the samples contradict it."""
        if self.prior is None:
            return None
        inflation = self._inflation()
        does_fit = self.prior.fits(poses, scores, self.told_moments, self._config.noise, slope, inflation)
        return self.prior.scaled(inflation) if does_fit else None


def _is_far(poses: Sequence[Pose], fitted: TeamPoses) -> bool:
    """Whether a fit moves a pose so far that samples seen with the old ones do not count."""
    pairs = zip(poses[1:], fitted.poses[1:], strict=True)
    steps = np.array([perturbation_between(old, new) for old, new in pairs]).reshape(-1, 2, 3)
    turns, shifts = np.linalg.norm(steps, axis=2).T
    uncertain = np.linalg.norm(fitted.deviations[1:, 3:], axis=1)
    return bool(np.any((turns > _FAR) | (shifts > np.maximum(_FAR_SHIFT, _FAR_IN_DEVIATIONS * uncertain))))
