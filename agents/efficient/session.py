"""One robot's estimate of its team, row by row: decides what is done with the rows of the whole team, and when.

row -> does its motion contradict the team?   drop it, and those that came with the contradiction
    -> is its wrench a surprise, or is it this robot's turn?   look -> fit to older rows -> look again -> new load
    -> since either: does another grasp explain all rows best?   go on from before, with that grasp elsewhere
    -> 15 % more rows than at the last fit?   fit -> do all rows fit? could it be a sensor instead of a load?
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from coheft.agents.efficient.judge import Outcome, Verdict, judge
from coheft.agents.efficient.knowledge import Knowledge
from coheft.agents.efficient.monitor import Monitor
from coheft.agents.efficient.settings import Guards
from coheft.agents.efficient.slips import Slip, Suspicion
from coheft.agents.efficient.stages import TRANSITIONS, Event, Stage
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.body import FORCING_SIZE
from coheft.estimation.moments.change import surprise
from coheft.estimation.moments.chapter import Prior
from coheft.estimation.moments.derivatives import MotionDerivatives
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.likelihood import wrench_evidence
from coheft.estimation.moments.misfit import KnownLoad
from coheft.estimation.moments.moments import RowMoments, wrench_moments
from coheft.estimation.moments.unknowns import THETA
from coheft.estimation.moments.untold import Untold

_ALIKE = 3.0
"""Steps of the mass are of one drift if neither is so many times the other."""


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
        changes: Of the load: number of its first row, and of the row at which that was noticed.
        slips: Of grasps.
        suspect: Place of a robot whose motion sensors contradict the others at present, or None.
        verdict: On the last fit.
        untold: An error of a sensor that was told to be zero, but that rows ask for; None if they ask for none.
        total_wrench: About the origin of the body frame, mean over the newest row, shape (6,); None before the first.
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

        def rows(seconds: float, least: int = 1) -> int:
            return max(least, round(seconds / settings.period))

        self._confirming = rows(guards.confirming, 3)
        self._waits, self._calm, self._drifting = rows(guards.waiting), rows(guards.calm), rows(guards.drifting)
        self._turn, self._lasting, self._longest = rows(guards.turn), rows(guards.lasting), rows(guards.undecided)
        self.stage = Stage.GATHERING
        self.changes: list[tuple[int, int]] = []
        self.slips: list[Slip] = []
        self._suspicion: Suspicion | None = None
        self.verdict = Verdict(Outcome.FITS)
        self.total_wrench: Array | None = None
        self.untold: Untold | None = None
        self._untold_rows = self._untold_until = 0  # with which it was found, and with which it is over
        self._most_suspected, self._untold_lasts = rows(guards.telling_apart), rows(guards.untold_lasts)
        self._loads = list[Array]()  # theta before each change
        self._told_of = self._newest = -1  # the newest change that another robot has told of; the newest row
        self._begin(Knowledge(count, anchor, settings, guards, prior))
        if prior is not None:
            self.stage, self._unconfirmed = TRANSITIONS[self.stage, Event.FITTED], self._confirming

    def _begin(self, known: Knowledge) -> None:
        """Go on from what is known, and from nothing else; changes that were noticed stay known."""
        self._known = known
        self._monitor = Monitor(self._count, self._guards)
        self.suspect: int | None = None
        self._load_before: KnownLoad | None = None  # before the oldest change that may still be a sensor's fault
        self._surprises, self._look_until, self._pause = 0, -1, -1
        self._unconfirmed = 0  # so many rows must still fit what was known
        self._doubted_at, self._contradicted_at = -1, -self._confirming
        self._forgot_at = -self._calm
        self._next_untold = self._known.first_untold
        self._asked_for: tuple[int, str] | None = None  # an error that rows have asked for once

    @property
    def estimate(self) -> Estimate | None:
        """Of poses and load, None at first."""
        return self._known.estimate

    def prior(self) -> Prior | None:
        """All that is known, for another team of which this robot is part; None if there is nothing to rely upon."""
        if self.stage is Stage.ESTIMATING and self._known.buffer.count and not self._look_for_change(self._newest):
            self._fit_and_judge()  # the newest rows have to be judged as well
        is_relied_upon = self.stage is Stage.ESTIMATING and self.untold is None and not self.is_suspected
        return self._known.prior() if is_relied_upon else None

    def claimable(self, estimate: Estimate) -> Estimate:
        """The estimate as it may be published, with drift of a load that repeatedly becomes lighter or heavier.

        It may have moved on as far as with the last change, in proportion to the time since.
        """
        if len(self.changes) < 2 or estimate.state.load is None:
            return estimate
        last, change = self._loads[-1] - self._loads[-2], estimate.state.load[THETA] - self._loads[-1]
        if not last[0] ** 2 / _ALIKE < change[0] * last[0] < last[0] ** 2 * _ALIKE:
            return estimate
        gap = max(1, self.changes[-1][0] - self.changes[-2][0])
        since = self._known.buffer.load_rows
        if gap > self._drifting or since > 3 * gap:
            return estimate
        step = (0.25 + 0.5 * since / gap) * change
        theta, seen = estimate.body.unknowns.theta, estimate.seen.copy()
        seen[theta, theta] += np.outer(step, step)
        return replace(estimate, seen=seen)

    @property
    def changed_at(self) -> int:
        """Number of the first row with the present load, -1 if it has never changed."""
        return self.changes[-1][0] if self.changes else -1

    @property
    def news_at(self) -> int:
        """Number of the first row after the newest change of whatever kind, -1 if there was none."""
        return max(self.changed_at, self.slips[-1].first if self.slips else -1)

    @property
    def is_suspected(self) -> bool:
        """Whether the load seems to have changed, but a grasp may have slipped instead."""
        return self._suspicion is not None and self._suspicion.is_load

    @property
    def certain_changes(self) -> list[tuple[int, int]]:
        """Changes of the load that may not be slips instead."""
        suspicion = self._suspicion
        return self.changes if suspicion is None else self.changes[: suspicion.changes]

    @property
    def is_confirmed(self) -> bool:
        """Whether what was known before rows were missing, or in a former team, has fitted rows since."""
        return self._unconfirmed == 0

    def hear_of_change(self, first: int, number: int) -> None:
        """Another robot has detected a load change at row ``first``: test for it here for a while."""
        if first > max(self.news_at + self._turn, self._told_of):
            self._told_of, self._look_until = first, number + self._turn

    def take(self, number: int, row: Array) -> None:
        """One more row of the whole team, shape (24 N + 1,) or (48 N + 1,); any may be missing or late."""
        self._take(number, row)
        if self._suspicion is not None:
            self._suspicion.add(number, row)
            self._tell_apart(self._suspicion)

    def _take(self, number: int, row: Array) -> None:
        known, buffer, guards = self._known, self._known.buffer, self._guards
        if number > self._newest + 1 + self._waits:
            self._unconfirmed = self._confirming
        self._newest = max(self._newest, number)
        if known.estimate is None:
            buffer.add(number, row)
        else:
            look = known.sight.look(row)
            if number == self._newest:
                self.total_wrench = look.view[FORCING_SIZE:]
            if not self._is_believed(number, look.motion):
                return
            place, has_moved = buffer.add(number, row)
            buffer.views[place] = look.view
            if self.stage is not Stage.GATHERING:
                if has_moved:
                    known.see_again()
                    self._monitor.forget()
                self._surprises = self._surprises + 1 if look.wrench @ look.wrench > guards.largest_surprise else 0
                is_own_turn = number % self._turn == self._own * self._turn // self._count
                is_urgent = self._surprises >= 2 or number <= self._look_until or not self.is_confirmed
                if (is_urgent or is_own_turn) and self._look_for_change(number):
                    return
        if known.is_fit_due and not self._look_for_change(number):
            self._fit_and_judge()
            if self.stage is Stage.ESTIMATING and known is self._known:
                known.fade()

    # --- contradictions ---

    def _is_believed(self, number: int, residuals: Array) -> bool:
        """Whether a row's motion may be learned from; a contradiction takes back the rows that came with it."""
        if self._known.misses_poses:
            return True
        found = self._monitor.add(residuals)
        if found is not None:
            is_first = self.suspect is None and number > self._contradicted_at + self._confirming
            if is_first and found.rows == 1:  # a sample that is wrong, or a jump that a late sensor saw a row later
                self._contradicted_at = number
                self._monitor.forget()
                return False
            if self.suspect is None or number > self._contradicted_at + self._confirming:
                self._doubted_at = number
            if self.suspect is None:
                numbers = self._known.buffer.numbers[: self._known.buffer.count]
                self._suspect(int(np.searchsorted(numbers, number - found.rows, side="right")), is_load=False)
                self._known.take_back(number - found.rows)
            self.suspect, self._contradicted_at = found.robot, number
            self._monitor.forget()
            if number - self._doubted_at > self._lasting:
                self._start_over()
            return False
        if self.suspect is not None and number - self._contradicted_at >= self._confirming:
            self.suspect, self._unconfirmed = None, self._confirming
            if not self.is_suspected:
                self._suspicion = None
        return self.suspect is None

    def _fit(self, before: int | None = None, keeps_motion: bool = False) -> Estimate:
        """See ``Knowledge.fit``; innovations count from now on."""
        self._monitor.forget()
        return self._known.fit(before, keeps_motion)

    def _fit_and_judge(self) -> None:
        """A fit, and whether all rows fit it, and whether it could not be a sensor instead of a load."""
        estimate, has_offset, guards = self._fit(), self._settings.has_offset, self._guards
        sight, buffer = self._known.sight, self._known.buffer
        self.verdict = judge(estimate, sight, buffer, guards, self._load_before, has_offset)
        first = buffer.count
        is_body = self.verdict.outcome not in (Outcome.NO_BODY, Outcome.MORE_THAN_TOLD)
        if self.stage is Stage.GATHERING and is_body:
            since, size = sight.likeliest_change(buffer)
            if size > guards.fresh_change:
                self.verdict, first = Verdict(Outcome.NO_LOAD), buffer.start + since
        match self.verdict.outcome:
            case Outcome.NO_BODY | Outcome.MORE_THAN_TOLD:
                self._start_over()
            case Outcome.NO_LOAD:
                self._forget_load(first, Event.MISFIT, estimate)
            case Outcome.UNDECIDED if self._newest - self.changed_at <= self._longest:
                self.stage = TRANSITIONS[self.stage, Event.UNDECIDED]
            case _:
                self.stage, self._load_before = TRANSITIONS[self.stage, Event.FITTED], None
                self._look_for_untold_errors()

    def _look_for_untold_errors(self) -> None:
        """Whether a sensor is off though it was told to be exact: then all begins anew, and nothing holds meanwhile.

        Rows have to ask for it twice. It is over when as many rows do not show it any more, the first time already
        after a shorter while.
        """
        rows = self._known.buffer.load_rows
        if rows < self._next_untold or self._known.misses_poses:
            return
        self._next_untold = round(self._guards.untold_growth * rows)
        found, before = self._known.untold_error(), self._asked_for
        self._asked_for = None if found is None else (found.robot, found.kind)
        if found is not None and self._asked_for != before:  # a sensor may have been off for a while only
            self._next_untold = 0
        elif found is not None:
            is_again = self._untold_rows > 0
            self.untold, self._untold_rows = found, max(rows, self._untold_rows)
            self._untold_until = self._untold_rows if is_again else min(rows, self._untold_lasts)
            self._start_over()
        elif rows >= self._untold_until:
            self.untold = None
            if rows > 2 * self._untold_rows:
                self._untold_rows = 0

    def _start_over(self) -> None:
        self.stage = TRANSITIONS[self.stage, Event.STARTED_OVER]
        self._begin(Knowledge(self._count, self._anchor, self._settings, self._guards))

    # --- grasps that slip ---

    def _suspect(self, place: int, is_load: bool) -> None:
        """From this place on the load seems to be another one, or motions contradict each other: or it was a slip."""
        known = self._known
        is_known = self.stage is Stage.ESTIMATING and not known.misses_poses
        if self._suspicion is None and is_known and known.is_exact:
            place = max(place, known.buffer.start)
            self._suspicion = Suspicion(known, place, self._newest, len(self.changes), is_load)

    def _tell_apart(self, suspicion: Suspicion) -> None:
        """What has changed: go on as if no grasp could slip, or from before the slip."""
        cause, is_late = suspicion.cause(self._guards), self._newest - suspicion.noticed >= self._most_suspected
        if cause is not None and cause.robot is not None:
            known = suspicion.known_if_slipped(self._known, cause, self._guards, self._settings.has_offset)
            if known is not None:
                self.slips.append(Slip(cause.robot, cause.first, suspicion.noticed, self._newest))
                self.stage, self._suspicion = TRANSITIONS[self.stage, Event.SLIPPED], None
                del self.changes[suspicion.changes :], self._loads[suspicion.changes :]
                self._begin(known)
                self._unconfirmed = self._confirming
                return
        if is_late or (suspicion.is_load and cause is not None and cause.robot is None):
            self._suspicion = None

    # --- changes of the load ---

    def _look_for_change(self, number: int) -> bool:
        """Whether the load has changed: what looks like it must still do so against a fit to older rows only."""
        if self.stage is Stage.GATHERING or number < self._pause:
            return False
        known, buffer = self._known, self._known.buffer
        if known.misses_poses and not self.is_confirmed:
            if buffer.count < known.least:  # so few rows do not find them
                return False
            self._fit(before=buffer.start, keeps_motion=True)  # wrenches may be of another load
        since, size = known.sight.likeliest_change(buffer)
        if size <= 1.0:
            self._unconfirmed = max(0, self._unconfirmed - 1)
            return False
        now = known.estimate
        if now is None or self._surprise(buffer.start + since, now) < self._guards.worth_a_fit:
            return False  # what is unknown may explain it, but that confirms nothing
        now = self._fit(before=buffer.start + since)
        place = buffer.start + known.sight.likeliest_change(buffer)[0]
        if now.state.load is None or self._surprise(place, now) <= 1.0:
            self._pause = number + buffer.count - place  # until there are twice as many rows
            self._fit()
            return False
        place, now = self._with_changes_before(place, now)
        load = now.state.load
        assert load is not None
        self._suspect(place, is_load=True)
        self._loads.append(load[THETA])
        self.changes.append((int(buffer.numbers[place]), number))
        if self._load_before is None:
            theta = now.body.unknowns.theta
            self._load_before = KnownLoad(load, now.covariance[theta, theta])
        self._forget_load(place, Event.LOAD_CHANGED, now)
        return True

    def _with_changes_before(self, place: int, now: Estimate) -> tuple[int, Estimate]:
        """Where the load changed first, if it has changed several times, and the fit to older rows only."""
        known, buffer = self._known, self._known.buffer
        since, size = known.sight.likeliest_change(buffer, place)
        while size > 1.0 and 0 < since < place - buffer.start:
            place = buffer.start + since
            now = self._fit(before=place)
            since, size = known.sight.likeliest_change(buffer, place)
        return place, now

    def _surprise(self, place: int, now: Estimate) -> float:
        """How much all rows from a place on look like another load, with all unknown that is unknown."""
        moments = wrench_moments(now.body, RowMoments.of(self._known.buffer.window(place)))
        assert now.state.load is not None
        evidence = wrench_evidence(now.body, MotionDerivatives.at(now.body), moments, now.state.load)
        return surprise(evidence, self._known.covariance_now(now), now.body.unknowns.theta)

    def _forget_load(self, place: int, event: Event, now: Estimate) -> None:
        """From this place on the load has to be found anew."""
        is_troubled = self._newest - self._forgot_at < self._calm
        least = self._known.least * (1 + is_troubled)
        self._known.forget_load(now, place, event is Event.LOAD_CHANGED, least)
        self._monitor.forget()
        self.stage = TRANSITIONS[self.stage, event]
        self._surprises, self._look_until = 0, -1
        self._forgot_at, self._unconfirmed = self._newest, 0
