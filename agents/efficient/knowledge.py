"""The knowledge of one robot: the rows of its team, the prior from earlier chapters, and the resulting estimate.

fit = likeliest state given the moments of all rows and the prior from earlier chapters
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from coheft.agents.efficient.innovations import ROWS_BEFORE, Innovations, Past
from coheft.agents.efficient.judge import Verdict, judge, misreading
from coheft.agents.efficient.load_drift import LoadDrift
from coheft.agents.efficient.one_load import OneLoad
from coheft.agents.efficient.pages import KEPT_ON_PAGE, Pages
from coheft.agents.efficient.row_times import LARGE_TEAM
from coheft.agents.efficient.settings import Guards
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.moments.body import BodyModel
from coheft.estimation.moments.change_at_fit import likeliest_step, surprise
from coheft.estimation.moments.chapter import Chapter, Prior
from coheft.estimation.moments.fit import Estimate, EvaluateMoments, fit_state
from coheft.estimation.moments.fit_settings import FitSettings, Guess
from coheft.estimation.moments.misfit import KnownLoad
from coheft.estimation.moments.misread import Misreading
from coheft.estimation.moments.pose_steps import ScoreDrift, likeliest_pose_step
from coheft.estimation.moments.row_buffer import RowBuffer
from coheft.estimation.moments.start import first_load, first_poses, poses_by_motion
from coheft.estimation.moments.suspects import SLIP
from coheft.estimation.moments.undeclared import KINDS_OF_ONE_ROBOT, UndeclaredError, undeclared_error
from coheft.estimation.moments.unknowns import THETA, Flags, State, Unknowns

_EXACT_UP_TO = 12
"""Largest team whose moments are kept exactly; for larger ones moments projected at one state are faster."""


class Knowledge:
    """Rows, prior and estimate since the robot last started from nothing.

    Args:
        count: Number of robots.
        anchor: Index of the robot whose pose fixes the body frame.
        settings: Settings of fits.
        guards: Thresholds and times.
        prior: Prior from a former team, None if there is none.

    Attributes:
        buffer: Rows of the team.
        estimate: Estimate of poses and load, None at first.
        innovations: Evaluates rows at the estimate; not set before there is one.
        least: Number of rows to which a load is fitted for the first time; twice as many if nothing is known.
        revision: How often rows have been evaluated anew, for instance after a fit.
    """

    innovations: Innovations
    _last_fit: OneLoad | None

    def __init__(
        self, count: int, anchor: int, settings: FitSettings, guards: Guards, prior: Prior | None = None
    ) -> None:
        self._count, self._anchor, self._settings, self._guards = count, anchor, settings, guards
        self._growth = guards.growth_of_many if settings.errors.count or count > LARGE_TEAM else guards.growth
        self.least = max(4, round(guards.first_rows / settings.period))
        size = settings.errors.row_size * count + 1
        self.buffer = RowBuffer(size, not self.is_small)
        self._chapter = Chapter(self.buffer, settings, prior)
        self.estimate: Estimate | None = None
        self.revision = 0
        self._past: Past | None = None  # the rows of earlier chapters
        self._next_fit, self._pages = 2 * self.least, Pages(settings)
        self._first: int | None = None  # number of the first row with the present load
        self._unfitted, self._last_fit = 0, None  # number of the first row whose wrench was not fitted, and the fit
        if prior is not None:
            evaluate, before = self._chapter.evaluation(), self._chapter.prior_evidence
            self._set_estimate(fit_state(prior.state, evaluate, before, prior.guess, settings, anchor, most_steps=1))

    @property
    def fitted(self) -> Estimate:
        """The estimate, of knowledge that has one."""
        if self.estimate is None:
            raise ValueError("there is no estimate; fit one first")
        return self.estimate

    @property
    def misses_poses(self) -> bool:
        """Whether the pose of any robot is unknown."""
        return self.estimate is None or self.estimate.misses_poses

    @property
    def theta(self) -> Array | None:
        """Mass, first moment and inertia of the load, shape (10,), None if it is unknown."""
        load = None if self.estimate is None else self.estimate.state.load
        return None if load is None else load[THETA]

    @property
    def is_small(self) -> bool:
        """Whether the team is small enough to keep moments exactly, and to look for rare events as well."""
        return self._count <= _EXACT_UP_TO

    @property
    def is_first_load(self) -> bool:
        """Whether all rows are of one load, and there is no prior."""
        return self._chapter.prior is None

    @property
    def may_show_slips(self) -> bool:
        """Whether a slip can be told from another load: a robot that holds it alone cannot."""
        return self.is_small and self._count > 1

    @property
    def drift(self) -> Array:
        """Variance (N, 12) or (1, 12) of motion sensors' drift since their mean innovations, in units of the noise."""
        return self._settings.drifted_kinematics((ROWS_BEFORE + self._pages.length) * self._settings.period)

    @property
    def is_fit_due(self) -> bool:
        """Whether there are enough rows for another fit."""
        return self.buffer.load_rows >= self._next_fit

    @property
    def age(self) -> int:
        """Number of rows since the first one with the present load, including those that were missing, and those that
        have become part of a prior; 0 before the first fit.
        """
        return 0 if self._first is None else self.buffer.number_at(self.buffer.count) - self._first

    def posterior(self, missing: float) -> Prior:
        """Everything that is known, as a prior for another team, whose first row is so much later [s]."""
        self.bridge(missing)
        prior = self._chapter.posterior(self.fitted, self._chapter.evaluation())
        return replace(prior, is_after_gap=missing > self._guards.waiting)

    def undeclared_error(self) -> UndeclaredError | None:
        """Return the most significant sensor error with tolerance zero, or None; large teams look for fewer kinds."""
        estimate, settings, false_alarm = self.estimate, self._settings, self._guards.undeclared
        if estimate is None:
            return None
        kinds = KINDS_OF_ONE_ROBOT if self.is_small else ()
        constant = undeclared_error(estimate, self._chapter, settings, self._anchor, kinds, false_alarm)
        late = self.innovations.late_sensor(settings.period, false_alarm)
        return max(filter(None, (constant, late)), key=lambda error: error.size, default=None)

    def judge(self, load_before: KnownLoad | None = None) -> Verdict:
        """Judge the estimate, see ``judge.judge``."""
        return judge(self.fitted, self.innovations, self.buffer, self._guards, self._settings, self.drift, load_before)

    def judge_by_motion(self) -> Verdict:
        """Judge a fit to the motion alone, which becomes the estimate: wrenches that fit no load make poses wrong."""
        if self.is_small and self.is_first_load:
            self.estimate = None  # a fit from poses that wrenches have moved far does not converge
        self.fit(end=self.buffer.start, keeps_motion=True)
        return self.judge()

    def misreading(self) -> Misreading | None:
        """What would make wrenches fit a load at the poses of the estimate; None if unknown, or may be chance."""
        is_known = not self.misses_poses and self.buffer.load_rows >= 2 * self.least
        rows = self.buffer.rows[self.buffer.of_load]
        return misreading(self.fitted.body, rows, self._guards) if self.is_small and is_known else None

    def reevaluate(self) -> None:
        """Evaluate all rows of the buffer again, because some have moved in it."""
        if self.estimate is not None:
            self._set_estimate(self.estimate)

    def take_back(self, number: int) -> None:
        """Remove the rows of the present load from this number on."""
        taken = self.buffer.take_back(number)
        if self.theta is not None:  # otherwise the load still needs as many rows
            self._next_fit -= taken

    def fit(self, end: int | None = None, keeps_motion: bool = False) -> Estimate:
        """Fit all unknowns to all rows, or to those before an index, and to the prior from earlier chapters.

        It becomes the estimate, at which rows are evaluated from now on, even if it leaves out some of them. Hidden
        poses are found anew, and so is a load that is unknown. For the arguments, see ``Chapter.evaluation``.
        """
        chapter, settings, last = self._chapter, self._settings, self.estimate
        if self._first is None:
            self._first = int(self.buffer.numbers[0])
            self._pages.begin(self._first)
        evaluate = chapter.evaluation(end, keeps_motion)
        state = State.first([Pose.identity()] * self._count, settings.errors) if last is None else last.state
        is_unknown = np.arange(self._count) != self._anchor if last is None else last.hidden_poses()
        if is_unknown.any():
            state = self._from_scratch(state, is_unknown, evaluate)
        if last is not None and state.load is not None:
            guess = last.guess
        else:
            body = settings.body(state)
            guess = Guess.of(body, self.buffer.moments()[1])
            state = first_load(state, evaluate(body).wrench, guess, settings)
        found = self._fit_from(state, guess, evaluate)
        self._set_estimate(found)
        self._unfitted = self.buffer.number_at(self.buffer.count if end is None else end)
        number = self.buffer.load_rows
        self._next_fit = number + max(3, round((self._growth - 1.0) * (number + self._pages.rows_before)))
        return found

    def forget_load(
        self, now: Estimate, index: int, has_changed: bool, least: int, step: tuple[int, Array] | None
    ) -> None:
        """Discard the load, which has to be estimated from ``least`` rows from this index on; poses stay.

        Args:
            now: What is known.
            index: Of the first row of the new load.
            has_changed: Whether wrenches before fitted their load, and no sensor may have been off; else they have
                misled the poses, too.
            least: Rows of the next fit.
            step: A step of theta that may have occurred before, see ``Chapter.end_of_load``.
        """
        chapter, state, self._first = self._chapter, now.state.with_load(None), self.buffer.number_at(index)
        chapter.end_of_load(now, index, has_changed and not now.misses_poses, step=step)
        if has_changed:  # poses stay, so rows need not be evaluated anew
            self.estimate = replace(now, body=self._settings.body(state))
        else:
            self._set_estimate(self._fit_from(state, now.guess, chapter.evaluation()))
        self._next_fit, self._pages.rows_before = least, 0  # a load that is known from few rows is fitted often

    def follow_drift(self, now: Estimate, index: int, drift: LoadDrift) -> bool:
        """If the load has changed at this index as it drifts, keep it, less certainly, and fit it to the rows from
        there on; return whether it has. ``now`` is the fit to the rows before.
        """
        noise = drift.process_noise(now, self.one_load(now, index).error_by_drift())
        newest = self.one_load(now).wrenches(index, self.buffer.count)
        step = likeliest_step(newest, self.covariance_now(now) + noise, now.body.unknowns.theta)
        if not drift.goes_on(float(step[0]), 0):
            return False
        self._chapter.end_of_load(now, index, True, noise)
        self.fit()
        return True

    def known_before(self, index: int) -> tuple[Estimate, Prior]:
        """Return the estimate from the rows before an index, and the same as a prior; changes nothing here."""
        chapter, now, evaluate = self._chapter, self.fitted, self._chapter.evaluation(index)
        found = self._fit_from(now.state, now.guess, evaluate)
        return found, chapter.posterior(found, evaluate)

    def change_within(self) -> int | None:
        """Return the index of the first row after a change among the rows that a load was fitted to, None if they are
        alike.
        """
        look = self.innovations.look_for_change()
        return self.buffer.start + look.first if look.statistic > self._guards.fresh_change else None

    def pose_step(self) -> int | None:
        """Return the index of the first row after a slip among the rows that were fitted, None if they are alike."""
        if self.misses_poses or not self.may_show_slips:
            return None
        now, settings = self.fitted, self._settings
        drift = ScoreDrift(now.body, self.buffer, settings) if settings.drift.is_any else None
        step = likeliest_pose_step(now, self._chapter, self._anchor, drift, self._guards.pose_step)
        return step.first if step is not None and step.statistic > 1.0 else None

    def known_from(self, prior: Prior) -> Estimate:
        """Return the estimate from a prior alone."""
        return Knowledge(self._count, self._anchor, self._settings, self._guards, prior).fitted

    def slipped(
        self, prior: Prior, robot: int, is_load: bool, rows: Iterable[tuple[int, Array]], past: Past, hidden: Flags
    ) -> Knowledge:
        """Return the knowledge from a prior and these rows with their numbers, if the grasp of a robot has slipped in
        between.

        If ``is_load``, the load has changed as well; everything else stays the same. ``past`` are the rows before the
        slip, and ``hidden`` (N,) says which poses are unknown in the prior.
        """
        unknowns = Unknowns(self._count, self._settings.errors)
        loosened = prior.with_process_noise(unknowns.poses[robot], np.diag(np.square(SLIP)))
        if is_load:
            loosened = loosened.without_load(unknowns, prior.guess.limits)
        others = (np.arange(1, self._count) + robot) % self._count
        anchor = int(others[np.argmin(hidden[others])]) if robot == self._anchor else self._anchor
        found = Knowledge(self._count, anchor, self._settings, self._guards, loosened)
        found._past = past
        for number, row in rows:
            found.buffer.add(number, row)
        found.fit()
        return found

    def body_at(self, state: State) -> BodyModel:
        """Return the matrices at a state."""
        return self._settings.body(state)

    def covariance_now(self, now: Estimate, later: int = 0) -> Array:
        """Covariance (u, u) of an estimate, with the drift of sensors over the rows that are kept and so many later."""
        if not self._settings.drift.is_any:
            return now.covariance
        indices, drifted = self._settings.drifted(now.body, (self.buffer.count + later) * self._settings.period)
        result = now.covariance.copy()
        result[np.ix_(indices, indices)] += drifted
        return result

    def surprise(self, index: int, now: Estimate) -> float:
        """Return the statistic of a load change at this index over its threshold, by a fit to the rows before; allows
        for all uncertainty.
        """
        newest = self.one_load(now).wrenches(index, self.buffer.count)
        return surprise(newest, self.covariance_now(now), now.body.unknowns.theta)

    def one_load(self, estimate: Estimate, end: int | None = None, is_last: bool = True) -> OneLoad:
        """Return a fit and the rows around it up to ``end``, or up to now, to work out what a change of the load makes
        wrong in the fit. It is that of the last call of ``fit``, or if not ``is_last``, to all rows before ``end``.
        """
        buffer = self.buffer
        fitted, last = buffer.index_of(self._unfitted), buffer.count if end is None else end
        fitted = min(fitted, last) if is_last else last
        if end is not None or estimate is not self.estimate:
            return OneLoad(estimate, self._chapter, fitted, last)
        if self._last_fit is None:
            self._last_fit = OneLoad(estimate, self._chapter, fitted, last)
        return self._last_fit.at(fitted, last)

    def fade(self) -> None:
        """End the page after a while, see ``Pages``."""
        if self._pages.length and not self.misses_poses and self.buffer.load_rows >= self._pages.length:
            self._end_page()

    def bridge(self, seconds: float) -> None:
        """End the page and inflate its prior for a time [s] without rows."""
        if self._pages.length and not self.misses_poses and self.theta is not None:
            self._end_page(seconds)

    def _end_page(self, missing: float = 0.0) -> None:
        """End the page, and inflate its prior for its time and for one without rows [s]."""
        estimate, buffer, chapter, pages = self.fitted, self.buffer, self._chapter, self._pages
        index = max(buffer.start, buffer.count - KEPT_ON_PAGE)
        seconds = pages.turn(index, buffer.number_at(index), missing)
        self._past = self.innovations.past
        chapter.prior = pages.inflated(chapter.end(estimate, index), estimate, seconds)
        self._set_estimate(estimate)
        self._next_fit = buffer.load_rows + max(3, round((self._growth - 1.0) * pages.rows_before))

    def _from_scratch(self, state: State, is_unknown: Flags, evaluate: EvaluateMoments) -> State:
        """Find unknown poses by the motion alone, without any guess."""
        settings, kept, chapter = self._settings, self.buffer.moments_kept(), self._chapter
        if chapter.prior is not None:
            return first_poses(kept, state, settings, is_unknown)
        return poses_by_motion(state, is_unknown, kept, evaluate, chapter.prior_evidence, settings, self._anchor)

    def _fit_from(self, state: State, guess: Guess, evaluate: EvaluateMoments) -> Estimate:
        return fit_state(state, evaluate, self._chapter.prior_evidence, guess, self._settings, self._anchor)

    def _set_estimate(self, estimate: Estimate) -> None:
        """Adopt an estimate and evaluate rows at it from now on."""
        self.estimate, self.revision, self._last_fit = estimate, self.revision + 1, None
        if not estimate.misses_poses:
            self.buffer.project_at(estimate.body)
        self.innovations = Innovations(estimate, self._chapter, self._past)
