"""One robot's estimation over the rows of its team: decides for each row what to test, and when to fit.

row -> does a robot's motion contradict the team?   drop the row, and those since the contradiction began
    -> is its wrench a surprise, or is it this robot's turn?   test for a change -> fit older rows -> test again
                                                               -> one more step of a drift?   the load stays known
    -> after either: does a slipped grasp explain all rows best?   go back, with the pose of that grasp loosened
    -> 15 or 30 % more rows than at the last fit?   fit -> do all rows fit? would a faulty sensor explain them as well?
"""

from __future__ import annotations

import numpy as np

from coheft.agents.efficient.causes import Causes
from coheft.agents.efficient.confirmation import Confirmation
from coheft.agents.efficient.contradictions import Contradictions, Use
from coheft.agents.efficient.judge import Outcome, Verdict
from coheft.agents.efficient.knowledge import Knowledge
from coheft.agents.efficient.load_drift import LoadChange, LoadDrift
from coheft.agents.efficient.looks import Looks
from coheft.agents.efficient.restlessness import Restlessness
from coheft.agents.efficient.settings import Guards, RowCounts
from coheft.agents.efficient.small_steps import UnnoticedStep
from coheft.agents.efficient.stages import TRANSITIONS, Event, Stage
from coheft.agents.efficient.undeclared_watch import UndeclaredWatch
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.body import FORCING_SIZE
from coheft.estimation.moments.chapter import Prior
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.misfit import KnownLoad
from coheft.estimation.moments.undeclared import UndeclaredError
from coheft.estimation.moments.unknowns import THETA
from coheft.estimation.moments.widening import widened


class Session:
    """Estimation of one robot while its team stays the same.

    Args:
        count: Number of robots.
        own: Index of this robot.
        settings: Settings of fits.
        guards: Thresholds and times.
        prior: What was learned in a former team, None if there is nothing.
        anchor: Index of the robot whose pose fixes the body frame; with a prior, one that was in the former team. All
            robots choose the same anchor, so that they compute the same numbers.

    Attributes:
        settings: Settings of fits; tolerances of sensors grow where they prove too small.
        stage: What is known of the load.
        causes: Load changes and slips of grasps.
        verdict: Verdict on the last fit.
        total_wrench: Total wrench about the origin of the body frame [N, N·m], mean over the newest row, shape (6,);
            None before the first row.
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
        self.settings, self._guards, self._declared = settings, guards, settings
        self._rows = RowCounts.of(guards, settings.period)
        self.stage = Stage.GATHERING
        self.causes = Causes(guards, self._rows)
        self.verdict = Verdict(Outcome.FITS)
        self.total_wrench: Array | None = None
        self._exceeded_with = 0  # number of rows with which sensor errors exceeded their tolerances; 0 if they do not
        self._undeclared = UndeclaredWatch(
            guards.undeclared_doubt, guards.undeclared_growth, self._rows.undeclared_lasts
        )
        self._steps = UnnoticedStep(self._rows.shortest, guards)
        self._looks = Looks(self._rows, own * self._rows.turn // count, guards.largest_surprise)
        self._newest = -1  # number of the newest row
        self._begin(Knowledge(count, anchor, settings, guards, prior))
        if prior is not None:
            self.stage = TRANSITIONS[self.stage, Event.FITTED]
            self._confirmation.begin(since=0)

    def _begin(self, known: Knowledge) -> None:
        """Continue from ``known`` alone; load changes that were noticed before stay listed."""
        self._known = known
        self._contradictions = Contradictions(self._count, self._guards, known.drift, self._rows)
        self._load_before: KnownLoad | None = None  # before the oldest change that may still be a sensor's fault
        self._looks.begin()
        self._steps.mass = 0.0
        self._confirmation = Confirmation(self._rows)
        self._restlessness = Restlessness(self._rows)
        self._undeclared.begin(known.rows_to_find_undeclared)

    @property
    def estimate(self) -> Estimate | None:
        """Estimate of poses and load, None at first."""
        return self._known.estimate

    def hand_over(self, missing: float) -> Prior | None:
        """Everything that is known, as the prior for another team of this robot; None if it cannot be relied upon.

        Args:
            missing: Time without rows until that team's first one [s].
        """
        if self.stage is Stage.ESTIMATING and self._known.buffer.count:  # the newest rows have to be judged as well
            if self._test_for_change(self._newest) and self.stage is not Stage.ESTIMATING:
                return None
            self._fit_and_judge()
        if self.settings is not self._declared:
            return None  # another team starts with the declared tolerances
        is_suspected = self.undeclared is not None or self.suspected is not None
        is_doubtful = is_suspected or self.causes.is_open or self._confirmation.distrusts_wrenches
        if self.stage is not Stage.ESTIMATING or is_doubtful:
            return None
        return self._known.posterior(self._steps, self.load_drift, missing)

    def claimable(self, estimate: Estimate) -> Estimate:
        """Return the estimate to publish: its covariance covers changes of the load that are not noticed yet."""
        return self._known.covering(self._steps.cover(estimate), self.load_drift)

    @property
    def load_drift(self) -> LoadDrift | None:
        """The drift of a load that keeps becoming lighter or heavier, None if it does not."""
        return self.causes.load_drift(self._known, self._newest)

    @property
    def unnoticed(self) -> float:
        """Mass by which the load may have changed without being noticed yet [kg]."""
        return self._steps.mass

    @property
    def contradicting(self) -> int | None:
        """Index of a robot whose motion sensors contradict the others at present, or None."""
        return self._contradictions.robot

    @property
    def undeclared(self) -> UndeclaredError | None:
        """A sensor error with tolerance zero that the rows show nevertheless, or None."""
        return self._undeclared.found

    @property
    def suspected(self) -> UndeclaredError | None:
        """Such an error that is not certain yet, or None; a load that drifts looks like one."""
        drift = self.load_drift
        return self._undeclared.suspected if drift is None or self._undeclared.since < drift.first else None

    @property
    def is_confirmed(self) -> bool:
        """Whether new rows have confirmed what was known before rows were missing, or in a former team."""
        return not self._confirmation.is_open

    def look_closely_after(self, first: int, number: int) -> None:
        """Test for a load change in every row for a while, as another robot has detected one at row ``first``."""
        self._looks.look_closely_after(first, self.causes.news_at, number)

    def take_back(self, number: int) -> None:
        """Remove the rows from this number on, as if they had never arrived; where that is not possible any more,
        start over.
        """
        known, buffer = self._known, self._known.buffer
        is_since_load = buffer.count > buffer.start and number > buffer.numbers[buffer.start]
        self.causes.take_back(number)
        self._newest = number - 1
        if is_since_load and not known.misses_poses:
            known.take_back(number)
        if not is_since_load or known.misses_poses or buffer.load_rows < known.least:
            self.settings, self._exceeded_with = self._declared, 0
            self._start_over()
            return
        self._fit()
        self._confirmation.begin(since=number)

    def take(self, number: int, row: Array) -> None:
        """Process a row of the whole team (X,), see ``Exchange.complete``; rows may be missing or arrive late."""
        self._take(number, row)
        self.causes.add(number, row)
        match self.causes.decide(self._known, self._newest):
            case Event.SLIPPED, Knowledge() as known:
                self.stage = TRANSITIONS[self.stage, Event.SLIPPED]
                self._begin(known)
                self._confirmation.begin(since=self._newest + 1)
            case Event.STARTED_OVER, None:
                self._start_over()

    def _expect_changes(self, since: int) -> None:
        """Rows before this one were missing, or not used: load and grasps may have changed meanwhile."""
        self._confirmation.begin(since)
        if self.stage is Stage.ESTIMATING and self._known.is_small:
            self.causes.expect(self._known, since)

    def _take(self, number: int, row: Array) -> None:
        known, buffer = self._known, self._known.buffer
        if self._newest < 0:
            if self.stage is Stage.ESTIMATING:  # another team has known this before
                self._expect_changes(since=number)
        elif number > self._newest + 1 + self._rows.waiting:
            known.bridge((number - self._newest - 1) * self.settings.period)
            self._expect_changes(since=number)
        self._newest = max(self._newest, number)
        if known.estimate is None:
            buffer.add(number, row)
        else:
            evaluated = known.innovations.evaluate(row)
            if number == self._newest:
                self.total_wrench = evaluated.view[FORCING_SIZE:]
            if not self._check_motion(number, evaluated.motion):
                return
            index, has_moved = buffer.add(number, row)
            buffer.views[index] = evaluated.view
            if self.stage is not Stage.GATHERING:
                if has_moved:
                    known.reevaluate()
                    self._contradictions.forget()
                is_due = self._looks.are_due(number, evaluated.wrench) or not self.is_confirmed
                if is_due and self._test_for_change(number):
                    return
        if known.is_fit_due and not self._test_for_change(number):
            self._fit_and_judge()
            if self.stage is Stage.ESTIMATING and known is self._known:
                known.fade()

    # --- contradictions ---

    def _check_motion(self, number: int, residuals: Array) -> bool:
        """Test a row's motion and return whether to use the row; remove the rows since a contradiction began."""
        if self._known.misses_poses:
            return True
        use, first = self._contradictions.add(number, residuals)
        match use:
            case Use.BACK_TO_FIRST:
                numbers = self._known.buffer.numbers[: self._known.buffer.count]
                self._suspect(int(np.searchsorted(numbers, first)), is_load=False)
                self._known.take_back(first)
            case Use.START_OVER:
                self._start_over()
            case Use.RESUME:
                self.causes.contradiction_ends()
                self._expect_changes(since=number)
        return use in (Use.KEEP, Use.RESUME)

    def _fit(self, end: int | None = None, keeps_motion: bool = False) -> Estimate:
        """Call ``Knowledge.fit`` and let the monitor sum innovations from now on."""
        self._contradictions.forget()
        return self._known.fit(end, keeps_motion)

    def _fit_trusted(self) -> Estimate:
        """Fit to all rows, but without wrenches that may be of another load."""
        known, confirmation = self._known, self._confirmation
        if not confirmation.distrusts_wrenches:
            return self._fit()
        return self._fit(end=known.buffer.index_of(confirmation.since), keeps_motion=True)

    def _fit_and_judge(self) -> None:
        """Fit, then test whether all rows fit and whether a faulty sensor would explain them as well as a load."""
        estimate, guards = self._fit_trusted(), self._guards
        if self._confirmation.distrusts_wrenches:
            return
        innovations, buffer = self._known.innovations, self._known.buffer
        self.verdict = self._known.judge(self._load_before)
        first = buffer.count
        is_body = self.verdict.outcome not in (Outcome.NO_BODY, Outcome.BEYOND_TOLERANCE)
        if self.stage is Stage.GATHERING and is_body:
            fresh = innovations.look_for_change(buffer)
            if fresh.statistic > guards.fresh_change:
                self.verdict, first = Verdict(Outcome.NO_LOAD), buffer.start + fresh.first
        match self.verdict.outcome:
            case Outcome.NO_BODY:
                self._start_over()
            case Outcome.BEYOND_TOLERANCE:
                if self._exceeded_with:  # not a passing cause
                    self.settings = widened(estimate, self.settings, self._declared) or self.settings
                    self.causes.forget_cause()
                self._exceeded_with = buffer.load_rows
                self._start_over()
            case Outcome.NO_LOAD:
                if not self._drifts_on():
                    self._forget_load(first, Event.MISFIT, estimate)
            case Outcome.UNDECIDED if self._newest - self.causes.changed_at <= self._rows.undecided:
                self.stage = TRANSITIONS[self.stage, Event.UNDECIDED]
            case _:
                self.stage, self._load_before = TRANSITIONS[self.stage, Event.FITTED], None
                if buffer.load_rows > 2 * self._exceeded_with:
                    self._exceeded_with = 0
                if self.load_drift is None and self._undeclared.test(self._known):
                    self._start_over()

    def _start_over(self) -> None:
        self.causes.start_over()
        self.stage = TRANSITIONS[self.stage, Event.STARTED_OVER]
        self._begin(Knowledge(self._count, self._anchor, self.settings, self._guards))

    # --- changes of the load ---

    def _suspect(self, index: int, is_load: bool) -> None:
        """See ``Causes.suspect``."""
        is_known = self.stage is Stage.ESTIMATING and not self._known.misses_poses
        if is_known and self._known.is_small:
            self.causes.suspect(self._known, index, self._newest, is_load)

    def _test_for_change(self, number: int) -> bool:
        """Return whether the load has changed, if only by one more step of a drift: a change must also show against a
        fit to the older rows only.
        """
        if self.stage is Stage.GATHERING or self._looks.are_paused(number):
            return False
        known, buffer = self._known, self._known.buffer
        if known.misses_poses and not self.is_confirmed:
            if buffer.count < known.least:  # too few rows to find them
                return False
            self._fit(end=buffer.start, keeps_motion=True)  # wrenches may be of another load
        now = known.estimate
        assert now is not None
        since, statistic, step = known.innovations.look_for_change(buffer, small=self._steps.sought(now))
        self._steps.take(step)
        if statistic <= 1.0:
            self._confirmation.count()
            return False
        index, confirmation = buffer.start + since, self._confirmation
        if known.surprise(index, now) < self._guards.worth_a_fit:  # uncertain poses may explain it
            if confirmation.is_open:
                confirmation.count()
                self._fit_trusted()
                self._looks.pause(until=number + self._rows.confirming)
            return False
        kept = min(index, buffer.index_of(confirmation.since)) if confirmation.is_open else index
        now = self._fit(end=kept, keeps_motion=confirmation.is_open)
        index = buffer.start + known.innovations.look_for_change(buffer).first
        if now.state.load is None or known.surprise(index, now) <= 1.0:
            if confirmation.is_open:
                return self._wait_for_poses(number, now)
            self._looks.pause(until=number + buffer.count - index)  # until there are twice as many rows
            self._fit()
            return False
        index, now = (kept, now) if confirmation.is_open else known.first_change(index, now)
        load, theta = now.state.load, now.body.unknowns.theta
        assert load is not None
        self._suspect(index, is_load=True)
        change = LoadChange(int(buffer.numbers[index]), number, load[THETA])
        if self._is_step_of_drift(change, index, now):
            return True
        if self._load_before is None:
            covered = known.covering(now, self.load_drift, index)
            known_before = now.body.unknowns.load if self.settings.has_offset else theta
            self._load_before = KnownLoad(load, covered.covariance[known_before, known_before])
        if change.first > self.causes.changed_at:
            self.causes.changes.append(change)
        self._forget_load(index, Event.LOAD_CHANGED, now)
        return True

    def _drifts_on(self) -> bool:
        """Whether rows fit no load because it drifts; it stays known then."""
        known, buffer = self._known, self._known.buffer
        if self.stage is not Stage.ESTIMATING or self.load_drift is None:
            return False
        look = known.innovations.look_for_change(buffer)
        index = buffer.start + look.first
        if look.statistic < self._guards.fresh_change or index == buffer.start:
            return False
        now = self._fit(end=index)
        assert known.theta is not None
        change = LoadChange(int(buffer.numbers[index]), self._newest, known.theta)
        if not self._is_step_of_drift(change, index, now):
            return False
        self.verdict = Verdict(Outcome.FITS)
        return True

    def _is_step_of_drift(self, change: LoadChange, index: int, now: Estimate) -> bool:
        """Whether a load change at this index is one more step of the load's drift; the load stays known then."""
        known, drift = self._known, self.causes.load_drift(self._known, change.first)
        is_known = self.stage is Stage.ESTIMATING and self.is_confirmed and not known.misses_poses
        if drift is None or not is_known or change.first <= self.causes.changed_at:
            return False
        if not known.follow_drift(now, index, drift):
            return False
        self.causes.changes.append(change)
        self._undeclared.dismiss(drift.first)
        self._contradictions.forget()
        self._looks.found()
        return True

    def _wait_for_poses(self, number: int, now: Estimate) -> bool:
        """Leave out unconfirmed wrenches for a while; after too long, forget the load and return True."""
        if self._confirmation.fits_badly(number):
            self._forget_load(self._known.buffer.index_of(self._confirmation.since), Event.MISFIT, now)
            return True
        self._fit_trusted()
        self._looks.pause(until=number + self._rows.confirming)
        return False

    def _forget_load(self, index: int, event: Event, now: Estimate) -> None:
        """Estimate the load anew from the row at this index on."""
        if self._restlessness.forget_load(self._newest):
            self._start_over()
            return
        least = self._known.least * (1 + self._restlessness.is_troubled)
        self._known.forget_load(now, index, event is Event.LOAD_CHANGED, least)
        self._contradictions.forget()
        self.stage = TRANSITIONS[self.stage, event]
        self._looks.found()
        self._confirmation.end()
