"""One robot's estimation over the rows of its team: decides for each row what to test, when to fit, what is known then.

row -> does a robot's motion contradict the team?   drop the row, and those since the contradiction began
    -> is it time to look for another load?         detect -> one more step of a drift? the load stays known
                                                           -> another load: estimate it anew from its first row on
    -> 15 or 30 % more rows than at the last fit?   look, fit -> do all rows fit? would a faulty sensor explain them?
    -> after either: does a slipped grasp explain all rows best?   go back, with the pose of that grasp loosened
"""

from __future__ import annotations

from functools import partial

import numpy as np

from coheft.agents.efficient.acceptance import Acceptance
from coheft.agents.efficient.causes import Causes
from coheft.agents.efficient.change_detector import ChangeDetector
from coheft.agents.efficient.contradictions import Contradictions, Use
from coheft.agents.efficient.judge import Verdict
from coheft.agents.efficient.knowledge import Knowledge
from coheft.agents.efficient.load_drift import LoadChange, LoadDrift
from coheft.agents.efficient.settings import Guards, RowCounts
from coheft.agents.efficient.slips import State
from coheft.agents.efficient.stages import STAGE_AFTER, Event, ResetMonitor, Stage
from coheft.agents.efficient.unnoticed import Gap, Unnoticed
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.body import FORCING_SIZE
from coheft.estimation.moments.chapter import Prior
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.misfit import KnownLoad
from coheft.estimation.moments.undeclared import UndeclaredError
from coheft.estimation.moments.unknowns import THETA


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
        stage: What is known of the load.
        causes: Load changes and slips of grasps.
        total_wrench: Total wrench about the origin of the body frame [N, N·m], mean over the newest row, shape (6,);
            None before the first row at the present poses.
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
        self._count, self._anchor, self._guards = count, anchor, guards
        self._rows = rows = RowCounts.of(guards, settings.period)
        self.stage = Stage.GATHERING
        self.causes = Causes(guards, rows)
        self._acceptance = Acceptance(settings, guards, rows)
        self._detector = ChangeDetector(rows, guards, own * rows.turn // count)
        self._resets = ResetMonitor(rows)
        self._gap, self._begins_after_gap = Gap(rows.waiting, guards), prior is not None and prior.is_after_gap
        self._newest = -1  # number of the newest row
        self._oldest = -1  # rows before this number are from before a slip, or are forgotten
        self._begin(Knowledge(count, anchor, settings, guards, prior))
        if prior is not None:
            self.stage = STAGE_AFTER[Event.FITTED]
            self._detector.confirm(since=0)

    def _begin(self, known: Knowledge) -> None:
        """Continue from ``known`` alone; load changes that were noticed before stay listed."""
        self._known = known
        self.total_wrench: Array | None = None
        self._contradictions = Contradictions(self._count, self._guards, known.drift, self._rows)
        self._detector.begin()
        self._acceptance.begin(known)

    # --- rows ---

    def take(self, number: int, row: Array) -> None:
        """Process a row of the whole team (X,), see ``Exchange.complete``; rows may be missing or arrive late."""
        self._take(number, row)
        self.causes.add(number, row)
        match self.causes.decide(self._known, self._newest):
            case Event.SLIPPED, Knowledge() as known:
                self.stage = STAGE_AFTER[Event.SLIPPED]
                self._begin(known)
                self._oldest = known.buffer.numbers[0]
                self._gap.load_begins(self.causes.changed_at)
                self._detector.confirm(since=self._newest + 1)
            case Event.STARTED_OVER, None:
                self._start_over()

    def _take(self, number: int, row: Array) -> None:
        """Enter the row unless it contradicts the team's motion; look for another load, and fit, if that is due."""
        if number < self._oldest:
            return
        self._prepare_for(number)
        known, buffer = self._known, self._known.buffer
        if known.estimate is None:
            buffer.add(number, row)
        else:
            evaluated = known.innovations.evaluate(row)
            if number == self._newest:
                self.total_wrench = evaluated.view[FORCING_SIZE:]
            if not self._check_motion(number, row, evaluated.motion):
                return
            index, has_moved = buffer.add(number, row)
            buffer.views[index] = evaluated.view
            if self.stage is not Stage.GATHERING:
                if has_moved:
                    known.reevaluate()
                if self._detector.is_due(number, evaluated) and self._look_for_change(number):
                    return
        if known.is_fit_due and not self._look_for_change(number):
            self._fit_and_judge()
            if self.stage is Stage.ESTIMATING and known is self._known:
                known.fade()

    def _prepare_for(self, number: int) -> None:
        """Note that a row with this number comes, possibly the first of a team or after missing ones."""
        missing, known = number - self._newest - 1, self._known
        if self._newest < 0:
            if self.stage is Stage.ESTIMATING:  # another team has known this before
                self._expect_changes(since=number)
                if self._begins_after_gap:
                    self._gap.begin(known, number)
        elif missing > self._rows.waiting:
            known.bridge(missing * self.settings.period)
            self._expect_changes(since=number)
            self._gap.begin(known, number)
        self._newest = max(self._newest, number)

    def _expect_changes(self, since: int) -> None:
        """Rows before this one were missing, or not used: load and grasps may have changed meanwhile.

        Two things begin: new rows have to confirm the load, and the causes of a change are compared.
        """
        self._detector.confirm(since)
        if self.stage is Stage.ESTIMATING and self._known.may_show_slips:
            self.causes.expect(self._known, since, self._detector.step)

    def _check_motion(self, number: int, row: Array, residuals: Array) -> bool:
        """Test a row's motion and return whether to use the row; remove the rows since a contradiction began."""
        if self._known.misses_poses:
            return True
        uncertainty = partial(self._known.innovations.motion_uncertainty, row)
        use, first = self._contradictions.add(number, residuals, self._known.revision, uncertainty)
        match use:
            case Use.BACK_TO_FIRST:
                numbers = self._known.buffer.numbers[: self._known.buffer.count]
                self._suspect(int(np.searchsorted(numbers, first)), State.CONTRADICTION)
                self.causes.contradiction_begins()
                self._known.take_back(first)
                self._detector.take_back()
            case Use.START_OVER:
                self._start_over()
            case Use.RESUME:
                self.causes.contradiction_ends(number)
                self._expect_changes(since=number)
                self._gap.begin(self._known, number)
        return use in (Use.KEEP, Use.RESUME)

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
            self._acceptance.tolerances.restore()
            self._start_over()
            return
        known.fit()
        self._detector.take_back()
        self._detector.confirm(since=number)
        if (index := known.pose_step()) is not None:
            self._suspect(index, State.POSE_CHANGED)

    def look_closely_after(self, first: int, number: int) -> None:
        """Test for a load change in every row for a while, as another robot has detected one at row ``first``."""
        self._detector.schedule.look_closely_after(first, self.causes.news_at, number)

    # --- fits ---

    def _fit_and_judge(self) -> None:
        """Fit, then judge the fit."""
        estimate = self._detector.fit(self._known)
        if self._detector.confirmation.distrusts_wrenches:
            return
        is_new, age = self.stage is Stage.GATHERING, self._newest - self.causes.changed_at
        event, index = self._acceptance.judge(self._known, estimate, is_new, age, self.load_drift is not None)
        match event:
            case Event.MISFIT:
                if not self._drifts_on():
                    self._forget_load(index, event, estimate)
            case Event.STARTED_OVER:
                self._start_over()
            case Event.POSE_CHANGED:
                self.stage = STAGE_AFTER[event]
                self._suspect(index, State.POSE_CHANGED)
            case _:
                self.stage = STAGE_AFTER[event]

    def _start_over(self) -> None:
        self.causes.start_over()
        self._gap.load_begins(self._newest)
        self._resets, self._oldest = ResetMonitor(self._rows), self._newest + 1
        self.stage = STAGE_AFTER[Event.STARTED_OVER]
        self._begin(Knowledge(self._count, self._anchor, self.settings, self._guards))

    # --- changes of the load ---

    def _look_for_change(self, number: int) -> bool:
        """Look for another load, and deal with it; return whether there is one, or one more step of a drift."""
        found = None if self.stage is Stage.GATHERING else self._detector.look(self._known, number)
        match found:
            case None:
                return False
            case (Event.LOAD_CHANGED, index, before, surprise):
                self._change_load(index, before, number, surprise)
            case (event, index, before, _):
                self._forget_load(index, event, before)
        return True

    def _change_load(self, index: int, before: Estimate, number: int, surprise: float) -> None:
        """The load has changed at this index, as is noticed at this row; for the others, see ``Detected``."""
        known, load, unknowns = self._known, before.state.fitted_load, before.body.unknowns
        self._suspect(index, State.LOAD_OR_SLIP)
        if self._follow_drift(index, before, number):
            return
        covered = Unnoticed(drift=self.load_drift).cover(known, before, index)
        known_before = unknowns.load if self.settings.has_offset else unknowns.theta
        self._acceptance.load_changes(KnownLoad(load, covered.covariance[known_before, known_before]))
        first = int(known.buffer.numbers[index])
        if first > self.causes.changed_at:
            self.causes.changes.append(LoadChange(first, number, load[THETA], surprise))
        self._forget_load(index, Event.LOAD_CHANGED, before)

    def _drifts_on(self) -> bool:
        """Whether rows fit no load because it drifts; it stays known then."""
        known = self._known
        if self.stage is not Stage.ESTIMATING or self.load_drift is None:
            return False
        index = known.change_within()
        if index is None or index == known.buffer.start:
            return False
        if not self._follow_drift(index, known.fit(end=index), self._newest):
            return False
        self._acceptance.accept()
        return True

    def _follow_drift(self, index: int, before: Estimate, number: int) -> bool:
        """Whether a change as in ``_change_load`` is one more step of the load's drift; the load stays known then."""
        known, first = self._known, int(self._known.buffer.numbers[index])
        drift = self.causes.load_drift(known, first)
        is_known = self.stage is Stage.ESTIMATING and self.is_confirmed
        if drift is None or not is_known or first <= self.causes.changed_at:
            return False
        if not known.follow_drift(before, index, drift):
            return False
        self.causes.changes.append(LoadChange(first, number, before.state.fitted_load[THETA]))
        self._acceptance.undeclared.dismiss(drift.first)
        self._detector.settle()
        return True

    def _forget_load(self, index: int, event: Event, before: Estimate) -> None:
        """Estimate the load anew from the row at this index on."""
        was_known = self.stage is Stage.ESTIMATING
        if self._resets.forget_load(self._newest, was_known):
            self._start_over()
            return
        if index < self._known.buffer.count:
            self.causes.load_begins(int(self._known.buffer.numbers[index]))
        self._gap.load_begins(self._known.buffer.number_at(index))
        least = self._known.least * (1 if was_known else 2)  # else rows of a faulty sensor may be among them
        fitted = event is Event.LOAD_CHANGED and self.stage is not Stage.UNDECIDED  # else a sensor may have been off
        step = self._detector.step.before_change(self._known, before, index)
        self._known.forget_load(before, index, fitted, least, step)
        self.stage = STAGE_AFTER[event]
        self._detector.settle()

    def _suspect(self, index: int, state: State) -> None:
        """From the row at this index on, load, motions or poses differ: compare the causes."""
        is_known = self.stage is Stage.ESTIMATING and not self._known.misses_poses
        if is_known and self._known.may_show_slips:
            self.causes.suspect(self._known, index, self._newest, state, self._detector.step)

    # --- what is known ---

    def hand_over(self, missing: float) -> Prior | None:
        """Everything that is known, as the prior for another team of this robot; None if it cannot be relied upon.
        ``missing`` is the time without rows until that team's first one [s].
        """
        if self.stage is Stage.ESTIMATING and self._known.buffer.count:  # the newest rows have to be judged as well
            if self._look_for_change(self._newest) and self.stage is not Stage.ESTIMATING:
                return None
            self._fit_and_judge()
        if not self._acceptance.tolerances.are_declared:
            return None  # another team starts with the declared tolerances
        is_suspected = self.undeclared is not None or self.suspected is not None
        is_doubtful = is_suspected or self.causes.is_open or self._detector.confirmation.distrusts_wrenches
        if self.stage is not Stage.ESTIMATING or is_doubtful:
            return None
        known = self._known
        if known.estimate is None or known.misses_poses or known.theta is None:
            return None
        # The other team could not notice what has not been noticed here.
        noise = self.unnoticed.process_noise(known, known.estimate, missing=missing / self.settings.period)
        prior = known.posterior(missing)
        return prior if noise is None else prior.with_process_noise(slice(None), noise)

    @property
    def settings(self) -> FitSettings:
        """Settings of fits; tolerances of sensors grow where they prove too small."""
        return self._acceptance.tolerances.settings

    @property
    def verdict(self) -> Verdict:
        """Verdict on the last fit."""
        return self._acceptance.verdict

    @property
    def estimate(self) -> Estimate | None:
        """Estimate of poses and load, None at first."""
        return self._known.estimate

    def claimable(self, estimate: Estimate) -> Estimate:
        """Return the estimate to publish: its covariance covers changes of the load that are not noticed yet."""
        return self.unnoticed.cover(self._known, estimate)

    @property
    def load_drift(self) -> LoadDrift | None:
        """The drift of a load that keeps becoming lighter or heavier, None if it does not."""
        return self.causes.load_drift(self._known, self._newest)

    @property
    def unnoticed(self) -> Unnoticed:
        """How the load may have changed without having been noticed yet, since a gap or in it."""
        return Unnoticed(max(self._detector.step, self._gap.step(self._known)), self.load_drift)

    @property
    def contradicting(self) -> int | None:
        """Index of a robot whose motion sensors contradict the others at present, or None."""
        return self._contradictions.robot

    @property
    def undeclared(self) -> UndeclaredError | None:
        """A sensor error with tolerance zero that the rows show nevertheless, or None."""
        return self._acceptance.undeclared.found

    @property
    def suspected(self) -> UndeclaredError | None:
        """Such an error that is not certain yet, or None; a load that drifts looks like one."""
        undeclared = self._acceptance.undeclared
        if undeclared.suspected is None:
            return None
        drift = self.load_drift
        return undeclared.suspected if drift is None or undeclared.since < drift.first else None

    @property
    def is_confirmed(self) -> bool:
        """Whether new rows have confirmed what was known before rows were missing, or in a former team."""
        return not self._detector.confirmation.is_open
