"""Detection of another load: when a robot looks for one, and whether what it sees is another load or uncertain poses.

a look is due, in turn, or if wrenches are a surprise, together show another mass, or another robot has noticed a change
              -> no window of rows is unlike the others      the load is confirmed a bit more
              -> poses are so uncertain that they explain it   fit again if the load is still to be confirmed
              -> fit to the rows before only
                 -> the other rows are unlike their load         another load
                 -> not, but the load is still to be confirmed   leave new wrenches out; after a while, it fits no more
                 -> not                                          look again when more of them have come, or in a while

Each fit becomes the estimate at which rows are evaluated: a comparison evaluates them at a fit to the rows before, and
is followed by a fit to all rows if nothing is detected. The detector changes neither the load nor what is known of it:
the session does that with what is detected.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from coheft.agents.efficient.innovations import EvaluatedRow
from coheft.agents.efficient.knowledge import Knowledge
from coheft.agents.efficient.settings import Guards, RowCounts
from coheft.agents.efficient.stages import Event
from coheft.agents.efficient.unnoticed import NO_STEP
from coheft.estimation.chi_square import chi_square_threshold
from coheft.estimation.moments.change import SmallStep, StepThresholds
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.row_buffer import RowBuffer
from coheft.estimation.moments.rows import WRENCH_SIZE
from coheft.estimation.moments.unknowns import THETA

_SURPRISES = 2
"""So many surprising rows in succession start a look."""
_LOOKS = 4
"""While the newest rows together show another mass, so many looks are started in the time over which they do."""
_PAUSED = 4
"""The next comparison is due after at least one row for so many that were compared: each costs several fits."""


class ChangeTestSchedule:
    """Says after each row whether to look for a load change: at once if there is a reason, else in turn.

    Args:
        rows: How often each robot looks without a reason (``turn``), and over how many rows another mass has to show.
        guards: Thresholds.
        slot: Number of the row of a turn after which this robot looks.
    """

    def __init__(self, rows: RowCounts, guards: Guards, slot: int) -> None:
        self._rows, self._slot, self._masses = rows, slot, deque[float](maxlen=rows.shortest)
        self._largest_surprise = chi_square_threshold(WRENCH_SIZE, guards.surprise)
        self._least_sum = chi_square_threshold(1, guards.mass_surprise) * rows.shortest
        self._news = -1  # first row of the newest change that another robot has reported
        self.begin()

    def begin(self) -> None:
        """Start again with other rows."""
        self._paused_until = -1
        self.found()

    def found(self) -> None:
        """Forget all reasons to look: what they pointed to has been found."""
        self._surprises, self._closely_until = 0, -1
        self._masses.clear()
        self._rests = 0  # so many rows have to come before the mass starts another look

    def is_paused(self, number: int) -> bool:
        """Whether a look is of no use yet at this row."""
        return number < self._paused_until

    def pause(self, until: int) -> None:
        """Looks before this row are of no use; -1: they are of use from now on."""
        self._paused_until = until

    def look_closely_after(self, first: int, news_at: int, number: int) -> None:
        """Look after every row for a while, if a change that another robot has noticed is news. ``first`` is its first
        row, ``news_at`` that of the newest change that this robot has noticed, and ``number`` the newest row.
        """
        if first > max(news_at + self._rows.turn, self._news):
            self._news, self._closely_until = first, number + self._rows.turn

    def is_due(self, number: int, row: EvaluatedRow) -> bool:
        """Whether to look after a row."""
        self._surprises = self._surprises + 1 if row.wrench @ row.wrench > self._largest_surprise else 0
        shows_another_mass = self._shows_another_mass(row.mass)
        is_urgent = self._surprises >= _SURPRISES or number <= self._closely_until or shows_another_mass
        return is_urgent or number % self._rows.turn == self._slot

    def _shows_another_mass(self, residual: float) -> bool:
        """Whether the newest rows together show another mass, and have not started a look shortly before."""
        masses = self._masses
        masses.append(residual)
        self._rests = max(0, self._rests - 1)
        shows = self._rests == 0 and len(masses) == masses.maxlen and sum(masses) ** 2 > self._least_sum
        if shows:
            self._rests = max(1, self._rows.shortest // _LOOKS)
        return shows


class Confirmation:
    """Counts rows that fit the load.

    The load may have changed while rows were missing, or while the team was another one, and poses are uncertain then.
    Those that had to explain the wrenches of another load would be wrong, and hide that it is another one. So wrenches
    that fit the load badly are left out of fits until poses are better known, and if the load turns out to have
    changed, none of them counts as a wrench of the former load. If that takes too long, the load is estimated anew.

    Args:
        rows: How many rows have to fit (``confirming``), and for how many wrenches may be distrusted (``lasting``).

    Attributes:
        since: Number of the first row that may be of another load.
    """

    def __init__(self, rows: RowCounts) -> None:
        self._rows = rows
        self._left = 0  # so many more rows have to fit
        self._distrusted_at: int | None = None
        self.since = -1

    @property
    def is_open(self) -> bool:
        """Whether more rows have to fit."""
        return self._left > 0

    @property
    def distrusts_wrenches(self) -> bool:
        """Whether wrenches fit the load so badly that only uncertain poses can explain it."""
        return self._distrusted_at is not None

    def begin(self, since: int) -> None:
        """Confirm the load from this row on, or from an earlier one that is not confirmed yet."""
        self.since = min(self.since, since) if self.is_open else since
        self._left = self._rows.confirming

    def end(self) -> None:
        """Stop: there is nothing to confirm any more."""
        self._left, self._distrusted_at = 0, None

    def count(self) -> None:
        """Count the newest row, which fits the load."""
        self._left, self._distrusted_at = max(0, self._left - 1), None

    def fits_badly(self, number: int) -> bool:
        """Note that wrenches fit the load badly at this row; return whether they have done so for too long."""
        if self._distrusted_at is None:
            self._distrusted_at = number
        return number - self._distrusted_at > self._rows.lasting


class Detected(NamedTuple):
    """What a look has detected.

    Attributes:
        event: ``LOAD_CHANGED``; ``MISFIT`` if a load that was to be confirmed has not fitted for too long.
        at: Index of the first row that does not belong to the load; after ``MISFIT``, of the first that may not.
        before: Fit to the rows before.
        surprise: Statistic of the change over the threshold.
    """

    event: Event
    at: int
    before: Estimate
    surprise: float = 1.0


class ChangeDetector:
    """Looks for changes of one team's load.

    Args:
        rows: How often it looks, and for how many rows a load is confirmed.
        guards: Thresholds.
        slot: Number of the row of a turn after which this robot looks without a reason.

    Attributes:
        schedule: When a look is due.
        confirmation: Whether the load is to be confirmed.
        step: The step of the mass that may not have been noticed yet.
    """

    def __init__(self, rows: RowCounts, guards: Guards, slot: int) -> None:
        self._rows, self._guards = rows, guards
        self.schedule = ChangeTestSchedule(rows, guards, slot)
        self.begin()

    def begin(self) -> None:
        """Start again with other knowledge."""
        self.schedule.begin()
        self.step, self.confirmation = NO_STEP, Confirmation(self._rows)
        self._is_likely = False  # whether the last look has nearly detected another load, which fits may hide since

    def confirm(self, since: int) -> None:
        """From this row on, the load may be another one, until new rows confirm it; looks are of use again."""
        self.confirmation.begin(since)
        self.schedule.pause(until=-1)
        self._is_likely = False

    def take_back(self) -> None:
        """Rows have been removed, and looks begin again; a step that they have shown may be in those that are left."""
        self.schedule.begin()
        self._is_likely = False

    def settle(self) -> None:
        """What was detected has been dealt with: the present load is that of the newest rows."""
        self.schedule.found()
        self.confirmation.end()
        self._is_likely = False

    def is_due(self, number: int, row: EvaluatedRow) -> bool:
        """Whether to look after a row."""
        return self.schedule.is_due(number, row) or self.confirmation.is_open or self._is_likely

    def fit(self, known: Knowledge) -> Estimate:
        """Fit to all rows, but without wrenches that may be of another load."""
        if not self.confirmation.distrusts_wrenches:
            return known.fit()
        return known.fit(end=known.buffer.index_of(self.confirmation.since), keeps_motion=True)

    def look(self, known: Knowledge, number: int) -> Detected | None:
        """Look for another load after the newest row, of this number; the load is known."""
        if self.schedule.is_paused(number):
            return None
        buffer, confirmation = known.buffer, self.confirmation
        if known.misses_poses and confirmation.is_open:
            if buffer.count < known.least:  # too few rows to find them
                return None
            known.fit(end=buffer.start, keeps_motion=True)  # wrenches may be of another load
        now = known.fitted
        guards, mass = self._guards, float(now.state.fitted_load[THETA.start])
        long_ago, recent = (chi_square_threshold(1, each) for each in (guards.small_step, guards.recent_step))
        small = StepThresholds(self._rows.shortest, long_ago, recent, mass)
        since, statistic, step = known.innovations.look_for_change(small)
        index, was_likely, self._is_likely = buffer.start + since, self._is_likely, False
        if not was_likely:
            if statistic <= 1.0:
                confirmation.count()
                self._note_step(step, buffer)
                return None
            if known.surprise(index, now) < guards.worth_a_fit:  # uncertain poses may explain it
                if confirmation.is_open:
                    confirmation.count()
                    self._refine(known, number)
                return None
        if confirmation.is_open:
            return self._compare_unconfirmed(known, index, number)
        found = self._compare(known, index, number)
        if found is None:
            self._note_step(step, buffer)
        return found

    def _note_step(self, found: SmallStep | None, buffer: RowBuffer) -> None:
        """Process the small step that a look has found, see ``Look.step``."""
        if found is not None:
            first = buffer.number_at(buffer.start + found.first)
            self.step = self.step.after_test(found, first, self._guards.small_step_fades)

    def _compare(self, known: Knowledge, index: int, number: int) -> Detected | None:
        """Compare the rows from this index on with a fit to the rows before only."""
        may_hide = known.is_small and known.is_first_load and not known.misses_poses
        found, least = self._change_at(known, index), self._guards.worth_a_fit
        rows = known.buffer.count - found.at
        if may_hide:
            found = self._change_in_first_load(known, found)
        if found.surprise > 1.0:
            return found
        self._is_likely = found.surprise > least
        until_detected = math.ceil(rows / max(found.surprise, least)) - rows  # the statistic grows with the rows
        self.schedule.pause(until=number + min(max(until_detected, rows // _PAUSED, 3), self._rows.turn))
        known.fit()
        return None

    def _change_at(self, known: Knowledge, index: int) -> Detected:
        """Return the change at this index or before, with a fit to the rows before it."""
        buffer, before = known.buffer, known.fit(end=index)
        first = buffer.start + known.innovations.look_for_change().first
        if first < index:  # rows of the other load were among those that were fitted
            before = known.fit(end=first)
        return Detected(Event.LOAD_CHANGED, first, before, known.surprise(first, before))

    def _change_in_first_load(self, known: Knowledge, found: Detected) -> Detected:
        """Return the change that a fit to all rows locates with all uncertainty; if it is no change, the one found.

        In the first load of a small team, poses and sensor errors are known from the rows of this load alone. If these
        are of two loads, they hide where it has changed.
        """
        located = self._change_at(known, known.one_load(known.fit()).likeliest_change())
        if located.surprise > self._guards.worth_a_fit and not located.before.misses_poses:
            return located._replace(surprise=max(found.surprise, located.surprise))
        return found

    def _compare_unconfirmed(self, known: Knowledge, index: int, number: int) -> Detected | None:
        """Compare the rows from this index on with a fit to the wrenches that are confirmed.

        Others are left out for a while; if they fit badly for too long, the load fits no more.
        """
        buffer, since = known.buffer, known.buffer.index_of(self.confirmation.since)
        kept = min(index, since)
        before = known.fit(end=kept, keeps_motion=True)
        index = buffer.start + known.innovations.look_for_change().first
        surprise = known.surprise(index, before)
        if surprise > 1.0:
            return Detected(Event.LOAD_CHANGED, kept, before, surprise)
        if self.confirmation.fits_badly(number):
            return Detected(Event.MISFIT, since, before)
        self._refine(known, number)
        return None

    def _refine(self, known: Knowledge, number: int) -> None:
        """Fit, as poses that become better known may explain the wrenches, and look again a few rows later."""
        self.fit(known)
        self.schedule.pause(until=number + self._rows.confirming)
