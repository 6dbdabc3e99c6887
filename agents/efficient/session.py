"""One robot's estimate of its team, row by row: when what is done with the rows of the whole team.

row -> does its motion contradict the team?   drop it, and those that came with the contradiction
    -> is its wrench a surprise, or is it this robot's turn?   look -> fit to older rows -> look again -> new load
    -> 15 % more rows than at the last fit?   fit
"""

from __future__ import annotations

from enum import Enum

import numpy as np

from agents.efficient.monitor import Monitor
from agents.efficient.settings import Guards
from coheft.estimation.moments.body import FORCING, load_operator, residual_covariance
from coheft.estimation.moments.change import Weights, likeliest_change, surprise
from coheft.estimation.moments.chapter import Chapter, Prior
from coheft.estimation.moments.derivatives import MotionDerivatives
from coheft.estimation.moments.fit import MOST_STEPS, Estimate, Look, fitted
from coheft.estimation.moments.fit_settings import FitSettings, Guess
from coheft.estimation.moments.likelihood import wrench_evidence
from coheft.estimation.moments.moments import RowMoments, view_moments, wrench_moments
from coheft.estimation.moments.row_buffer import VIEW_SIZE, RowBuffer
from coheft.estimation.moments.rows import KINEMATICS_SIZE, ROW_SIZE
from coheft.estimation.moments.start import first_load, first_poses
from coheft.estimation.moments.unknowns import Flags, State
from coheft.estimation.spatial import Array, Pose

_EXACT_UP_TO = 12
"""Robots of a team whose moments are kept exactly: beyond, what is seen from one state is faster."""


class Stage(Enum):
    """What a session is doing."""

    GATHERING = "gathering rows of a load that is not known yet"
    ESTIMATING = "the load is known"
    DOUBTING = "a robot's sensors contradict the team's motion"


class Event(Enum):
    """What takes it from one stage to another."""

    FITTED = "a load has been fitted"
    LOAD_CHANGED = "the load is another one"
    CONTRADICTED = "a robot's sensors contradict the others"
    CLEARED = "they have not done so for a while, and the load is known"
    CLEARED_UNKNOWN = "they have not done so for a while, and the load is not known"
    STARTED_OVER = "all is forgotten, because poses may be wrong"


TRANSITIONS = {
    (Stage.GATHERING, Event.FITTED): Stage.ESTIMATING,
    (Stage.ESTIMATING, Event.FITTED): Stage.ESTIMATING,
    (Stage.ESTIMATING, Event.LOAD_CHANGED): Stage.GATHERING,
    (Stage.GATHERING, Event.CONTRADICTED): Stage.DOUBTING,
    (Stage.ESTIMATING, Event.CONTRADICTED): Stage.DOUBTING,
    (Stage.DOUBTING, Event.CONTRADICTED): Stage.DOUBTING,
    (Stage.DOUBTING, Event.CLEARED): Stage.ESTIMATING,
    (Stage.DOUBTING, Event.CLEARED_UNKNOWN): Stage.GATHERING,
    (Stage.GATHERING, Event.STARTED_OVER): Stage.GATHERING,
    (Stage.ESTIMATING, Event.STARTED_OVER): Stage.GATHERING,
    (Stage.DOUBTING, Event.STARTED_OVER): Stage.GATHERING,
}
"""All that can happen; anything else is an error in this file."""


class Session:
    """Since the team is what it is.

    Args:
        count: Robots.
        own: Place of this one; all is seen in its frame.
        settings: Of fits.
        guards: Thresholds and times.
        prior: What was learned in a former team.

    Attributes:
        stage: What it is doing.
        estimate: What is known, None at first.
        changes: Of the load: number of its first row, and of the row at which that was noticed.
        suspect: Place of the robot whose sensors contradict the others, while the stage is ``DOUBTING``.
    """

    def __init__(self, count: int, own: int, settings: FitSettings, guards: Guards, prior: Prior | None = None) -> None:
        self._count, self._own, self._settings, self._guards = count, own, settings, guards
        self._growth = guards.growth_of_errors if settings.errors.count else guards.growth
        self._least = max(4, round(guards.first_rows / settings.period))
        self._turn = max(1, round(guards.turn / settings.period))
        self._clear = max(4, round(guards.clear_rows / settings.period))
        self._lasting = round(guards.lasting / settings.period)
        self.estimate: Estimate | None = None
        self.suspect: int | None = None
        self.changes: list[tuple[int, int]] = []
        self._told_of = -1  # the newest change that another robot has told of
        self.stage = Stage.GATHERING
        self._begin(prior)
        if prior is not None:
            self._guess = prior.guess
            self.estimate = fitted(
                prior.state, self._chapter.look(), self._chapter.said_before, prior.guess, settings, own, most_steps=1
            )
            self.stage = TRANSITIONS[self.stage, Event.FITTED]
            self._see_with(self.estimate)

    def _begin(self, prior: Prior | None = None) -> None:
        """With an empty buffer."""
        size = ROW_SIZE * self._count + 1
        settings, count = self._settings, self._count
        self._buffer = RowBuffer(size, settings.errors.is_moving, settings.period, count > _EXACT_UP_TO)
        self._chapter = Chapter(self._buffer, settings, prior)
        self._monitor = Monitor(count, self._guards)
        self.estimate, self.suspect = None, None
        self._next_fit, self._surprises, self._look_until = self._least, 0, -1
        self._in_vain, self._pause, self._level = 0, -1, 1.0
        self._doubted_at = self._contradicted_at = -1

    def prior(self) -> Prior | None:
        """All that is known, for another team of which this robot is part; None if there is nothing to rely upon."""
        estimate = self.estimate
        if self.stage is not Stage.ESTIMATING or estimate is None or estimate.hidden_poses().any():
            return None
        return self._chapter.summed_up(estimate, self._guess)

    @property
    def changed_at(self) -> int:
        """Number of the first row with the present load, -1 if it has never changed."""
        return self.changes[-1][0] if self.changes else -1

    def hear_of_change(self, first: int, number: int) -> None:
        """Another robot has found that the load changed at row ``first``: look for oneself for a while."""
        if first > max(self.changed_at + self._turn, self._told_of):
            self._told_of, self._look_until = first, number + self._turn

    def take(self, number: int, row: Array) -> None:
        """One more row of the whole team, shape (24 N + 1,); any may be missing or late."""
        row = self._buffer.extended(number, row)
        if self.estimate is None:
            self._buffer.add(number, row)
            if self._buffer.load_rows >= self._next_fit:
                self._fit()
            return
        looked = self._matrices @ row
        view, wrench, motion = np.split(looked, (VIEW_SIZE, VIEW_SIZE + 6))
        if not self._is_believed(number, row, motion, self.estimate):
            return
        place, has_moved = self._buffer.add(number, row)
        if self.stage is Stage.GATHERING:
            if self._buffer.load_rows >= self._next_fit:
                self._fit()
            return
        if has_moved:
            self._see_with(self.estimate)
        self._buffer.views[place] = view
        self._surprises = self._surprises + 1 if wrench @ wrench > self._guards.largest_surprise else 0
        is_own_turn = number % self._turn == self._own * self._turn // self._count
        if (self._surprises >= 2 or number <= self._look_until or is_own_turn) and self._look_for_change(number):
            return
        if self._buffer.load_rows >= self._next_fit and not self._look_for_change(number):
            self._fit()

    # --- contradictions ---

    def _is_believed(self, number: int, row: Array, residuals: Array, estimate: Estimate) -> bool:
        """Whether a row's motion may be learned from; a contradiction takes back the rows that came with it."""
        if estimate.hidden_poses().any():
            return True
        found = self._monitor.add(residuals, estimate.body.see @ row, estimate)
        if found is not None:
            if self.stage is not Stage.DOUBTING:
                self._doubted_at = number
                taken_back = self._buffer.take_back(number - found.rows)
                self._next_fit -= taken_back
            self.stage, self.suspect = TRANSITIONS[self.stage, Event.CONTRADICTED], found.robot
            self._contradicted_at = number
            self._monitor.forget()
            if number - self._doubted_at > self._lasting:
                self._start_over()
            return False
        if self.stage is Stage.DOUBTING and number - self._contradicted_at >= self._clear:
            event = Event.CLEARED_UNKNOWN if estimate.state.load is None else Event.CLEARED
            self.stage, self.suspect = TRANSITIONS[self.stage, event], None
        return self.stage is not Stage.DOUBTING

    def _start_over(self) -> None:
        self.stage = TRANSITIONS[self.stage, Event.STARTED_OVER]
        self._begin()

    # --- changes of the load ---

    def _look_for_change(self, number: int) -> bool:
        """Whether the load has changed: what looks like it must still do so against a fit to older rows only."""
        if number < self._pause:
            return False
        since, size = self._likeliest_change()
        if size <= 1.0:
            return False
        buffer = self._buffer
        self._fit(before=buffer.start + since)
        since, now = self._likeliest_change()[0], self.estimate
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
        self._in_vain = 0
        self.changes.append((int(buffer.numbers[place]), number))
        self._chapter.end_of_load(now, self._guess, place, not now.hidden_poses().any())
        body = self._settings.body(now.state.with_load(None), self._level)
        self.estimate = Estimate(body, now.seen, now.hidden, now.step, now.size, now.level)
        self.stage = TRANSITIONS[self.stage, Event.LOAD_CHANGED]
        self._surprises, self._look_until, self._next_fit = 0, -1, self._least
        return True

    def _likeliest_change(self) -> tuple[int, float]:
        buffer = self._buffer
        return likeliest_change(buffer.views[buffer.start : buffer.count], self._before, self._weights)

    # --- fits ---

    def _fit(self, before: int | None = None) -> None:
        """Fit all unknowns to all rows, or to those before a place, and to chapters before."""
        chapter, settings, last = self._chapter, self._settings, self.estimate
        look = chapter.look(before)
        identity = [Pose.identity()] * self._count
        state = State.first(identity, settings.errors) if last is None else last.state
        is_unknown = np.arange(self._count) != self._own if last is None else last.hidden_poses()
        if is_unknown.any():
            state = self._from_scratch(state, is_unknown, look)
        if state.load is None:
            body = settings.body(state, self._level)
            self._guess = Guess.of(body, self._buffer.moments()[1])
            state = first_load(state, look(body).wrench, self._guess, settings, self._level)
        self.estimate = fitted(
            state, look, chapter.said_before, self._guess, settings, self._own, MOST_STEPS, self._level
        )
        self._level = self.estimate.level
        self.stage = TRANSITIONS[self.stage, Event.FITTED]
        self._see_with(self.estimate)
        number = self._buffer.load_rows
        self._next_fit = max(number + 3, round(self._growth * number))

    def _from_scratch(self, state: State, is_unknown: Flags, look: Look) -> State:
        """Poses from far away, by motion alone."""
        settings, kept = self._settings, self._buffer.moments_kept()
        state = first_poses(kept, state, settings.noise, self._own, is_unknown)
        if self._chapter.prior is not None:
            return state
        state = state.with_load(None)
        guess = Guess.of(settings.body(state), kept)
        return fitted(state, look, self._chapter.said_before, guess, settings, self._own).state

    def _see_with(self, estimate: Estimate) -> None:
        """See all rows that are kept with an estimate, and from now on each that comes."""
        body, buffer, load = estimate.body, self._buffer, estimate.state.load
        assert load is not None
        if not estimate.hidden_poses().any():
            buffer.see_from(body)
        of_all, of_load = buffer.moments()
        see = np.vstack([body.see[FORCING], body.wrench])
        buffer.views[: buffer.count] = buffer.rows[: buffer.count] @ see.T
        summed = buffer.views[buffer.start : buffer.start + buffer.load_summed]
        self._before = np.zeros((VIEW_SIZE, VIEW_SIZE))
        if not buffer.keeps_whole_load:
            self._before = view_moments(body, of_load) - summed.T @ summed
        self._weights = Weights.of(body, load, self._chapter.said_before(body))
        root = np.linalg.cholesky(residual_covariance(body, load))
        whitened = np.linalg.solve(root, body.wrench - load_operator(load) @ body.see[FORCING])
        residuals, one = body.whitened_residuals(), ROW_SIZE * self._count
        sums = of_all.sums(one)
        mean = residuals @ (sums / max(float(sums[one]), 1.0))
        is_twist = np.arange(len(mean)) % KINEMATICS_SIZE < 6
        residuals[:, one] -= np.where(is_twist, mean, 0.0)  # what gyros and velocities always read in excess
        self._matrices = np.vstack([see, whitened, residuals])
        self._monitor.forget()
