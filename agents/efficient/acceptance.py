"""What follows from a fit: whether it is accepted, and what has to begin anew if not.

motions fit no body, or sensor errors exceed their tolerances   start over; tolerances grow if it happens twice in a row
wrenches fit no load, or those of a new load change within      estimate the load anew
a sensor's offset explains them as well as another load         undecided for a while
newest rows show another pose of a grasp                        accepted, but a grasp may have slipped
all rows fit                                                    accepted, unless a sensor shows an undeclared error
"""

from __future__ import annotations

from dataclasses import replace

from coheft.agents.efficient.judge import Outcome, Verdict
from coheft.agents.efficient.knowledge import Knowledge
from coheft.agents.efficient.settings import Guards, RowCounts
from coheft.agents.efficient.stages import Event
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.misfit import KnownLoad
from coheft.estimation.moments.undeclared import UndeclaredError
from coheft.estimation.moments.widening import widened

_ROWS_TO_FIND = 3
"""An undeclared error is found with so many times the rows of a first fit; with fewer it is suspected."""


class UndeclaredWatch:
    """Tests for sensor errors whose tolerance is zero, at growing intervals.

    Two tests in a row have to find the same error; one that is less certain, or that few rows show, is suspected. An
    error is over once as many rows in succession are free of it as it was found with, or ``lasts`` rows.

    Args:
        doubt: Size from which on an error is suspected.
        growth: The next test is due when the number of rows has grown by this factor, in large teams by its square.
        lasts: Number of rows after which an error is over that does not show any more.

    Attributes:
        found: The error, None if there is none.
        suspected: The most significant one in the last test, None if it may be chance.
        since: Number of the row since which one is suspected.
    """

    def __init__(self, doubt: float, growth: float, lasts: int) -> None:
        self.found: UndeclaredError | None = None
        self.suspected: UndeclaredError | None = None
        self.since = 0
        self._doubt, self._growth, self._lasts = doubt, growth, lasts
        self._over_with = 0  # rows of the load when the error is over
        self.begin(0)

    def begin(self, least: int) -> None:
        """Start again with other rows; to find an error takes so many."""
        self._least, self._next, self._tested_with = least, 0, 0
        self._last_found: tuple[int | None, str] | None = None

    def dismiss(self, since: int) -> None:
        """An error that is only suspected since this row or later was no error."""
        if self.since >= since:
            self.suspected = self._last_found = None

    def test(self, known: Knowledge) -> bool:
        """Test if it is due; return whether an error has been found, after which estimation has to start over."""
        rows = known.buffer.load_rows
        if known.misses_poses or self._tested_with <= rows < self._next:
            return False
        largest, last, self._tested_with = known.undeclared_error(), self._last_found, rows
        if self.suspected is None:
            self.since = int(known.buffer.numbers[known.buffer.count - 1])
        self.suspected = largest if largest is not None and largest.size > self._doubt else None
        growth = self._growth if known.is_small else self._growth**2
        self._next = round(growth * rows) if self.suspected is None else 0
        found = self.suspected
        if found is None or found.size <= 1.0 or rows < self._least:
            self._last_found = None
            if known.age >= self._over_with:
                self.found = None
            return False
        self._last_found = found.robot, found.kind
        if self._last_found != last:  # a sensor may have been faulty for a while only
            return False
        self.found, self._over_with = found, min(known.age, self._lasts)
        return True


class Tolerances:
    """The tolerances that one team's fits assume: as declared, until the errors found exceed them twice in a row.
    ``settings`` are those of fits with the present ones.
    """

    def __init__(self, declared: FitSettings) -> None:
        self._declared = self.settings = declared
        self._exceeded_with = 0  # rows of the load when errors exceeded them; 0 if they do not

    @property
    def are_declared(self) -> bool:
        """Whether they are the declared ones."""
        return self.settings is self._declared

    def exceed(self, estimate: Estimate, rows: int) -> None:
        """Process a fit after so many rows of the load whose errors exceed them; if that was so before, they grow."""
        if self._exceeded_with > 0:  # it is no passing cause
            self.settings = widened(estimate, self.settings, self._declared) or self.settings
        self._exceeded_with = rows

    def hold(self, rows: int) -> None:
        """Process a fit after so many rows of the load whose errors are within them."""
        if rows > 2 * self._exceeded_with:
            self._exceeded_with = 0

    def restore(self) -> None:
        """Assume the declared ones again."""
        self.settings, self._exceeded_with = self._declared, 0


class Acceptance:
    """Accepts one team's fits or not, by settings with the declared tolerances.

    ``verdict`` is that on the last fit, ``tolerances`` are those that fits assume, and ``undeclared`` watches the
    undeclared errors that they show.
    """

    def __init__(self, settings: FitSettings, guards: Guards, rows: RowCounts) -> None:
        self._undecided = rows.undecided
        self.verdict = Verdict(Outcome.FITS)
        self.tolerances = Tolerances(settings)
        self.undeclared = UndeclaredWatch(guards.undeclared_doubt, guards.undeclared_growth, rows.undeclared_lasts)
        self._load_before: KnownLoad | None = None  # before the oldest change that may still be a sensor's fault

    def begin(self, known: Knowledge) -> None:
        """Start again with other knowledge."""
        self._load_before = None
        self.undeclared.begin(_ROWS_TO_FIND * known.least)

    def load_changes(self, before: KnownLoad) -> None:
        """The load seems to have changed from this one; fits to the next one may show that it was a sensor's fault."""
        if self._load_before is None:
            self._load_before = before

    def judge(self, known: Knowledge, estimate: Estimate, is_new: bool, age: int, drifts: bool) -> tuple[Event, int]:
        """Judge a fit to all rows; return what follows, and the index of the row from which on the load or a pose is
        another one, if that follows.

        If ``is_new``, the load is fitted for the first time; ``age`` is its number of rows. A load that drifts looks
        like an undeclared error.
        """
        end = known.buffer.count
        self.verdict = known.judge(self._load_before)
        if is_new and self.verdict.outcome not in (Outcome.NO_BODY, Outcome.BEYOND_TOLERANCE):
            changed = known.change_within()
            if changed is not None:
                self.verdict, end = Verdict(Outcome.NO_LOAD), changed
        match self.verdict.outcome:
            case Outcome.NO_BODY:
                by_motion = known.judge_by_motion()
                if by_motion.outcome is Outcome.NO_LOAD:
                    self.verdict = replace(by_motion, misreading=known.misreading())
                elif by_motion.outcome is Outcome.NO_BODY:
                    self.verdict = by_motion
                return Event.STARTED_OVER, end
            case Outcome.BEYOND_TOLERANCE:
                self.tolerances.exceed(estimate, known.age)
                return Event.STARTED_OVER, end
            case Outcome.NO_LOAD:
                self.verdict = replace(self.verdict, misreading=known.misreading())
                return Event.MISFIT, end
            case Outcome.UNDECIDED if age <= self._undecided:
                return Event.UNDECIDED, end
            case _:
                self._load_before = None
                self.tolerances.hold(known.age)
                if not drifts and self.undeclared.test(known):
                    return Event.STARTED_OVER, end
                stepped = known.pose_step()
                return (Event.FITTED, end) if stepped is None else (Event.POSE_CHANGED, stepped)

    def accept(self) -> None:
        """Accept the last fit after all."""
        self.verdict = Verdict(Outcome.FITS)
