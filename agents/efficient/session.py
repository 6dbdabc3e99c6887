"""One robot's estimate of its team, row by row: when what is done with the rows of the whole team.

row -> does its motion contradict the team?   drop it, and those that came with the contradiction
    -> is its wrench a surprise, or is it this robot's turn?   look -> fit to older rows -> look again -> new load
    -> 15 % more rows than at the last fit?   fit -> do all rows fit? could it be a sensor instead of a load?
"""

from __future__ import annotations

import math
from dataclasses import replace
from enum import Enum

import numpy as np

from agents.efficient.judge import Outcome, Verdict, judge
from agents.efficient.monitor import Monitor
from agents.efficient.settings import Guards
from agents.efficient.sight import Sight
from coheft.estimation.moments.change import surprise
from coheft.estimation.moments.chapter import Chapter, Prior
from coheft.estimation.moments.derivatives import MotionDerivatives
from coheft.estimation.moments.fit import MOST_STEPS, Estimate, Look, fitted
from coheft.estimation.moments.fit_settings import FitSettings, Guess
from coheft.estimation.moments.likelihood import wrench_evidence
from coheft.estimation.moments.misfit import Settled
from coheft.estimation.moments.moments import RowMoments, wrench_moments
from coheft.estimation.moments.row_buffer import RowBuffer
from coheft.estimation.moments.rows import ROW_SIZE
from coheft.estimation.moments.start import first_load, first_poses
from coheft.estimation.moments.unknowns import THETA, Flags, State
from coheft.estimation.spatial import Array, Pose

_PAGES_IN_MEMORY, _KEPT_ON_PAGE = 8, 2
"""A memory that fades does so in so many steps; each leaves the newest rows to go on from."""
_EXACT_UP_TO = 12
"""Robots of a team whose moments are kept exactly: beyond, what is seen from one state is faster."""


class Stage(Enum):
    """What a session knows of the load."""

    GATHERING = "gathering rows of a load that is not known yet"
    UNDECIDED = "either the load has changed or a sensor reads something in excess"
    ESTIMATING = "the load is known"


class Event(Enum):
    """What takes it from one stage to another."""

    FITTED = "a load has been fitted"
    UNDECIDED = "a load has been fitted, but a sensor that reads something in excess explains wrenches as well"
    LOAD_CHANGED = "the load is another one"
    MISFIT = "wrenches do not fit the load that was fitted to them"
    STARTED_OVER = "all is forgotten, because motions do not fit the poses that were fitted to them"


TRANSITIONS = {
    (Stage.GATHERING, Event.FITTED): Stage.ESTIMATING,
    (Stage.GATHERING, Event.UNDECIDED): Stage.UNDECIDED,
    (Stage.GATHERING, Event.MISFIT): Stage.GATHERING,
    (Stage.GATHERING, Event.STARTED_OVER): Stage.GATHERING,
    (Stage.UNDECIDED, Event.FITTED): Stage.ESTIMATING,
    (Stage.UNDECIDED, Event.UNDECIDED): Stage.UNDECIDED,
    (Stage.UNDECIDED, Event.LOAD_CHANGED): Stage.GATHERING,
    (Stage.UNDECIDED, Event.MISFIT): Stage.GATHERING,
    (Stage.UNDECIDED, Event.STARTED_OVER): Stage.GATHERING,
    (Stage.ESTIMATING, Event.FITTED): Stage.ESTIMATING,
    (Stage.ESTIMATING, Event.LOAD_CHANGED): Stage.GATHERING,
    (Stage.ESTIMATING, Event.MISFIT): Stage.GATHERING,
    (Stage.ESTIMATING, Event.STARTED_OVER): Stage.GATHERING,
}
"""All that can happen; anything else is an error in this file."""


class Session:
    """Since the team is what it is.

    Args:
        count: Robots.
        own: Place of this one.
        settings: Of fits.
        guards: Thresholds and times.
        prior: What was learned in a former team.
        anchor: Place of the robot whose pose fixes the body frame; with a prior one that was in the former team. All
            robots take the same one, so that they come to the same numbers.

    Attributes:
        stage: What it knows of the load.
        estimate: Of poses and load, None at first.
        changes: Of the load: number of its first row, and of the row at which that was noticed.
        suspect: Place of a robot whose motion sensors contradict the others at present, or None.
        verdict: On the last fit.
    """

    def __init__(
        self,
        count: int,
        own: int,
        settings: FitSettings,
        guards: Guards,
        prior: Prior | None = None,
        anchor: int = 0,
    ) -> None:
        self._count, self._own, self._anchor = count, own, anchor
        self._settings, self._guards = settings, guards
        self._growth = guards.growth_of_errors if settings.errors.count else guards.growth

        def rows(seconds: float, least: int = 1) -> int:
            return max(least, round(seconds / settings.period))

        self._least, self._clear = rows(guards.first_rows, 4), rows(guards.clear_rows, 4)
        memory = settings.memory
        self._page = 0 if memory is None else rows(memory / _PAGES_IN_MEMORY, 4)
        self._waits, self._confirming = rows(guards.waiting), rows(guards.confirming, 3)
        self._calm, self._drifting = rows(guards.calm), rows(guards.drifting)
        self._turn, self._lasting, self._longest = rows(guards.turn), rows(guards.lasting), rows(guards.undecided)
        self.stage = Stage.GATHERING
        self.estimate: Estimate | None = None
        self.suspect: int | None = None
        self.changes: list[tuple[int, int]] = []
        self.verdict = Verdict(Outcome.FITS)
        self._before: Array | None = None  # theta before the last change
        self._told_of = self._newest = -1  # the newest change that another robot has told of; the newest row
        self._begin(prior)
        if prior is not None:
            self._guess = prior.guess
            look, before = self._chapter.look(), self._chapter.said_before
            self._know(fitted(prior.state, look, before, prior.guess, settings, anchor, most_steps=1))
            self.stage, self._unconfirmed = TRANSITIONS[self.stage, Event.FITTED], self._confirming

    def _begin(self, prior: Prior | None = None) -> None:
        """With an empty buffer."""
        settings, size = self._settings, ROW_SIZE * self._count + 1
        is_large = self._count > _EXACT_UP_TO
        self._buffer = RowBuffer(size, settings.errors.is_moving, settings.period, is_large)
        self._chapter = Chapter(self._buffer, settings, prior)
        self._monitor = Monitor(self._count, self._guards)
        self.estimate, self.suspect = None, None
        self._settled: Settled | None = None  # the load before the last change, while that is undecided
        self._next_fit, self._surprises, self._look_until = self._least, 0, -1
        self._in_vain, self._pause, self._level, self._rows_before = 0, -1, 1.0, 0
        self._unconfirmed = 0  # so many rows must still fit what was known
        self._doubted_at = self._contradicted_at = -1
        self._forgot_at = -self._calm

    def prior(self) -> Prior | None:
        """All that is known, for another team of which this robot is part; None if there is nothing to rely upon."""
        if self.stage is Stage.ESTIMATING and self._buffer.count and not self._look_for_change(self._newest):
            self._fit()  # so that the newest rows have been judged as well
            self._judge()
        estimate = self.estimate
        if self.stage is not Stage.ESTIMATING or estimate is None or estimate.misses_poses:
            return None
        return self._chapter.summed_up(estimate, self._guess)

    def claimable(self, estimate: Estimate) -> Estimate:
        """The estimate as it may be told: a load that changes again and again drifts meanwhile.

        It may have moved on as far as with the last change, in proportion to the time since.
        """
        if len(self.changes) < 2 or self._before is None or estimate.state.load is None:
            return estimate
        gap = max(1, self.changes[-1][0] - self.changes[-2][0])
        since = self._buffer.load_rows
        if gap > self._drifting or since > 3 * gap:
            return estimate
        step = (0.25 + 0.5 * since / gap) * (estimate.state.load[THETA] - self._before)
        theta, seen = estimate.body.unknowns.theta, estimate.seen.copy()
        seen[theta, theta] += np.outer(step, step)
        return replace(estimate, seen=seen)

    @property
    def changed_at(self) -> int:
        """Number of the first row with the present load, -1 if it has never changed."""
        return self.changes[-1][0] if self.changes else -1

    @property
    def is_confirmed(self) -> bool:
        """Whether what was known before rows were missing, or in a former team, has fitted rows since."""
        return self._unconfirmed == 0

    def hear_of_change(self, first: int, number: int) -> None:
        """Another robot has found that the load changed at row ``first``: look for oneself for a while."""
        if first > max(self.changed_at + self._turn, self._told_of):
            self._told_of, self._look_until = first, number + self._turn

    def take(self, number: int, row: Array) -> None:
        """One more row of the whole team, shape (24 N + 1,); any may be missing or late."""
        buffer, row = self._buffer, self._buffer.extended(number, row)
        if number > self._newest + 1 + self._waits:
            self._unconfirmed = self._confirming
        self._newest = max(self._newest, number)
        if self.estimate is None:
            buffer.add(number, row)
        else:
            look = self._sight.look(row)
            if not self._is_believed(number, row, look.motion, self.estimate):
                return
            place, has_moved = buffer.add(number, row)
            buffer.views[place] = look.view
            if self.stage is not Stage.GATHERING:
                if has_moved:
                    self._know(self.estimate)
                self._surprises = (
                    self._surprises + 1 if look.wrench @ look.wrench > self._guards.largest_surprise else 0
                )
                is_own_turn = number % self._turn == self._own * self._turn // self._count
                is_urgent = self._surprises >= 2 or number <= self._look_until or not self.is_confirmed
                if (is_urgent or is_own_turn) and self._look_for_change(number):
                    return
        if buffer.load_rows >= self._next_fit and not self._look_for_change(number):
            self._fit()
            self._judge()
            if self._page and buffer.load_rows >= self._page and self.stage is Stage.ESTIMATING:
                self._turn_page()

    @property
    def _misses_poses(self) -> bool:
        """Whether the pose of a robot is not known."""
        return self.estimate is None or self.estimate.misses_poses

    # --- contradictions ---

    def _is_believed(self, number: int, row: Array, residuals: Array, estimate: Estimate) -> bool:
        """Whether a row's motion may be learned from; a contradiction takes back the rows that came with it."""
        if self._misses_poses:
            return True
        found = self._monitor.add(residuals, estimate.body.see @ row, estimate)
        if found is not None:
            if self.suspect is None or number > self._contradicted_at + self._clear:
                self._doubted_at = number
            if self.suspect is None:
                self._next_fit -= self._buffer.take_back(number - found.rows)
            self.suspect, self._contradicted_at = found.robot, number
            self._monitor.forget()
            if number - self._doubted_at > self._lasting:
                self._start_over()
            return False
        if self.suspect is not None and number - self._contradicted_at >= self._clear:
            self.suspect, self._unconfirmed = None, self._confirming
        return self.suspect is None

    def _judge(self) -> None:
        """After a fit: whether all rows fit, and whether it could not be a sensor instead of a load."""
        estimate, has_offset = self.estimate, self._settings.has_offset
        assert estimate is not None
        buffer, guards = self._buffer, self._guards
        self.verdict = judge(estimate, self._sight, buffer, guards, self._settled, has_offset)
        first = buffer.count
        if self.stage is Stage.GATHERING and self.verdict.outcome is not Outcome.NO_BODY:
            since, size = self._sight.likeliest_change(buffer)
            if size > guards.fresh_change:
                self.verdict, first = Verdict(Outcome.NO_LOAD), buffer.start + since
        match self.verdict.outcome:
            case Outcome.NO_BODY:
                self._start_over()
            case Outcome.NO_LOAD:
                self._forget_load(first, Event.MISFIT, estimate)
            case Outcome.UNDECIDED if self._newest - self.changed_at <= self._longest:
                self.stage = TRANSITIONS[self.stage, Event.UNDECIDED]
            case _:
                self.stage, self._settled = TRANSITIONS[self.stage, Event.FITTED], None

    def _start_over(self) -> None:
        self.stage = TRANSITIONS[self.stage, Event.STARTED_OVER]
        self._begin()

    # --- changes of the load ---

    def _look_for_change(self, number: int) -> bool:
        """Whether the load has changed: what looks like it must still do so against a fit to older rows only."""
        if self.stage is Stage.GATHERING or number < self._pause:
            return False
        buffer = self._buffer
        if self._misses_poses and not self.is_confirmed:
            if buffer.count < self._least:  # so few rows do not find them
                return False
            self._fit(before=buffer.start, keeps_motion=True)  # wrenches may be of another load
        since, size = self._sight.likeliest_change(buffer)
        if size <= 1.0:
            self._unconfirmed = max(0, self._unconfirmed - 1)
            return False
        self._fit(before=buffer.start + since)
        since, now = self._sight.likeliest_change(buffer)[0], self.estimate
        assert now is not None
        assert now.state.load is not None
        place = buffer.start + since
        moments = wrench_moments(now.body, RowMoments.of(buffer.window(place)))
        evidence = wrench_evidence(now.body, MotionDerivatives.at(now.body), moments, now.state.load)
        if surprise(evidence, now.covariance, now.body.unknowns.theta) <= 1.0:
            is_recent = number < self._pause + 2 ** (self._guards.patience + 1)
            self._in_vain = min(self._in_vain + 1, self._guards.patience) if is_recent else 1
            self._pause = number + 2**self._in_vain
            self._fit()
            return False
        self._in_vain, self._before = 0, now.state.load[THETA]
        self.changes.append((int(buffer.numbers[place]), number))
        if self._settled is None:
            theta = now.body.unknowns.theta
            self._settled = Settled(now.state.load, now.covariance[theta, theta])
        self._forget_load(place, Event.LOAD_CHANGED, now)
        return True

    def _forget_load(self, place: int, event: Event, now: Estimate) -> None:
        """From this place on the load has to be found anew; what was learned of poses before stays."""
        has_changed, state = event is Event.LOAD_CHANGED, now.state.with_load(None)
        self._chapter.end_of_load(now, self._guess, place, has_changed and not now.misses_poses)
        if has_changed:
            body = self._settings.body(state, self._level)
            self.estimate = Estimate(body, now.seen, now.hidden, now.step, now.size, now.level)
        else:  # wrong wrenches have moved the poses, too
            chapter = self._chapter
            look, before = chapter.look(), chapter.said_before
            self._know(fitted(state, look, before, self._guess, self._settings, self._anchor))
        self.stage = TRANSITIONS[self.stage, event]
        is_troubled = self._newest - self._forgot_at < self._calm
        self._surprises, self._look_until, self._next_fit = 0, -1, self._least * (1 + is_troubled)
        self._forgot_at, self._unconfirmed = self._newest, 0

    # --- fits ---

    def _fit(self, before: int | None = None, keeps_motion: bool = False) -> None:
        """Fit all unknowns to all rows, or to those before a place, and to chapters before; see ``Chapter.look``."""
        chapter, settings, last = self._chapter, self._settings, self.estimate
        look = chapter.look(before, keeps_motion)
        identity = [Pose.identity()] * self._count
        state = State.first(identity, settings.errors) if last is None else last.state
        is_unknown = np.arange(self._count) != self._anchor if last is None else last.hidden_poses()
        if is_unknown.any():
            state = self._from_scratch(state, is_unknown, look)
        if state.load is None:
            body = settings.body(state, self._level)
            self._guess = Guess.of(body, self._buffer.moments()[1])
            state = first_load(state, look(body).wrench, self._guess, settings, self._level)
        self._know(
            fitted(state, look, chapter.said_before, self._guess, settings, self._anchor, MOST_STEPS, self._level)
        )
        number = self._buffer.load_rows
        self._next_fit = number + max(3, round((self._growth - 1.0) * (number + self._rows_before)))

    def _turn_page(self) -> None:
        """The memory fades: what was learned of the load counts less, as if it had drifted meanwhile."""
        estimate, settings, buffer = self.estimate, self._settings, self._buffer
        if estimate is None or settings.memory is None or estimate.misses_poses:
            return
        place = max(0, buffer.count - _KEPT_ON_PAGE)
        faded = math.expm1(place * settings.period / settings.memory)
        theta = estimate.body.unknowns.theta
        self._rows_before = round(settings.memory / settings.period)
        self._chapter.end(estimate, self._guess, place, is_cut=False)
        if self._chapter.prior is not None:
            self._chapter.prior = self._chapter.prior.loosened(theta, faded * estimate.covariance[theta, theta])
        self._know(estimate)
        self._next_fit = buffer.load_rows + max(3, round((self._growth - 1.0) * self._rows_before))

    def _from_scratch(self, state: State, is_unknown: Flags, look: Look) -> State:
        """Poses from far away, by motion alone."""
        settings, kept = self._settings, self._buffer.moments_kept()
        state = first_poses(kept, state, settings.noise, self._anchor, is_unknown)
        if self._chapter.prior is not None:
            return state
        state = state.with_load(None)
        guess = Guess.of(settings.body(state), kept)
        return fitted(state, look, self._chapter.said_before, guess, settings, self._anchor).state

    def _know(self, estimate: Estimate) -> None:
        """From now on this is what is known, and how rows are seen."""
        self.estimate, self._level = estimate, estimate.level
        self._sight = Sight(estimate, self._chapter)
        self._monitor.forget()
