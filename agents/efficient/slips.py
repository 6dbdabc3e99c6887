"""Distinguish a grasp that has slipped from a load that has changed, and from faulty sensors.

A small slip looks like another load at first, because torques are about another point; a large one contradicts the
motion of the team. The session reacts to both as if no grasp could slip. Meanwhile a ``Suspicion`` compares all rows
since then with what was known before, by the log ratios of ``coheft.estimation.moments.suspects``. Only a slip that is
much likelier than all other causes, and with which all rows fit, replaces what the session has found meanwhile. Rows
that may be from before it are left out then: one of them would do more harm than several later rows do good.

After missing rows, load and grasps may have changed unseen, even both. So there is a suspicion without any notice, and
nothing is valid while its rows are likelier with a slip. It goes on after a load change if motions contradict each
other before the new load is known: a grasp may have slipped because of it.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable
from enum import Enum
from functools import partial
from typing import NamedTuple

import numpy as np

from coheft.agents.efficient.judge import Outcome
from coheft.agents.efficient.knowledge import Knowledge
from coheft.agents.efficient.settings import Guards
from coheft.agents.efficient.state_before_change import StateBeforeChange
from coheft.agents.efficient.unnoticed import Unnoticed
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.chapter import EvidenceAt
from coheft.estimation.moments.moments import RowMoments, evaluated_moments
from coheft.estimation.moments.suspects import LogRatios, latest_start, log_ratio_to_knock, log_ratios
from coheft.estimation.moments.unknowns import THETA

_LEAST, _GROWTH = 5, 1.5
"""Number of rows at which causes are first compared, and the factor by which it grows until the next comparison."""
_BEFORE, _STEP = 30, 8
"""The change may be so many rows older than its notice. Its first row is searched in such steps, then in finer ones."""


class Slip(NamedTuple):
    """A grasp that slipped.

    Attributes:
        robot: Index of the robot.
        first: Number of the first row after the slip.
        noticed: Number of the row at which a change of some kind was noticed.
        named: Number of the row at which it was identified as this slip.
    """

    robot: int
    first: int
    noticed: int
    named: int


class Cause(NamedTuple):
    """The cause of a change.

    Attributes:
        robot: Index of the robot whose grasp has slipped, None if the cause is the load or a sensor.
        first: Number of the row that is most likely the first one after the change.
        is_load: Whether the load has changed, possibly as well as the grasp.
        may_be_older: Whether the change may as well be older than all rows that were compared: then these and what was
            known before are alike, and may both be from after it.
    """

    robot: int | None
    first: int
    is_load: bool = False
    may_be_older: bool = False


class State(Enum):
    """What is known of a change whose cause is not."""

    CONTRADICTION = "motions contradict each other: a grasp has slipped, or a sensor is faulty"
    POSE_CHANGED = (
        "newest rows show another pose of a grasp: it has slipped, the load has shifted, or a sensor is faulty"
    )
    LOAD_OR_SLIP = "wrenches differ: the load has changed, or a grasp has slipped"
    AFTER_GAP = "rows were missing: the load may have changed, a grasp may have slipped, or both"
    EXPECTED_LOAD = "a change was expected, and wrenches differ"
    EXPLAINED = "what was noticed is explained, but more may have occurred"
    LOAD_CHANGED = "the load has changed for certain; a grasp may have slipped as well"


class Suspicion:
    """A change whose cause is not known yet: what was known before, and all rows since.

    Args:
        before: What was known before.
        rows: Rows since by their numbers, and some from shortly before.
        first: Number of the first row after the change, as far as is known.
        noticed: Number of the row at which it was noticed.
        changes: Number of load changes before.
        state: What is known of the change.

    Attributes:
        noticed, changes: As given.
        favours_change: Whether rows are likelier with a change that is only expected, of a grasp or of the load.
    """

    def __init__(
        self,
        before: StateBeforeChange,
        rows: dict[int, Array],
        first: int,
        noticed: int,
        changes: int,
        state: State,
    ) -> None:
        self._before, self._rows, self._first = before, rows, first
        self._next, self._tried = _LEAST, dict[int, LogRatios]()
        self.noticed, self.changes, self._state = noticed, changes, state
        self._began_after_gap = state is State.AFTER_GAP
        self._contradicts, self.favours_change = False, state is State.POSE_CHANGED
        self._oldest = -1  # rows before this number are of another load
        self._rests = False  # if it rests, nothing is compared until motions contradict each other

    @staticmethod
    def of_change(
        known: Knowledge,
        index: int,
        noticed: int,
        changes: int,
        state: State,
        unnoticed: Unnoticed,
        later: int,
    ) -> Suspicion:
        """The suspicion when a change is noticed; the row at ``index`` is the first after it, as far as is known."""
        buffer = known.buffer
        begin = max(index - _BEFORE, (buffer.start + index) // 2)
        numbers = buffer.numbers[begin : buffer.count].tolist()
        rows = dict(zip(numbers, buffer.rows[begin : buffer.count].copy(), strict=True))
        first = numbers[index - begin] if index < buffer.count else noticed
        return Suspicion(StateBeforeChange.of(known, begin, unnoticed, later), rows, first, noticed, changes, state)

    @staticmethod
    def after_gap(known: Knowledge, since: int, changes: int, unnoticed: Unnoticed, later: int) -> Suspicion:
        """The suspicion when rows have been missing; ``since`` is the number of the first row that is not."""
        missing = max(0, since - known.buffer.number_at(known.buffer.count))
        before = StateBeforeChange.of(known, known.buffer.count, unnoticed, later, missing)
        return Suspicion(before, {}, since, since, changes, State.AFTER_GAP)

    @property
    def is_load(self) -> bool:
        """Whether it looks like a load change."""
        return self._state in (State.LOAD_OR_SLIP, State.EXPECTED_LOAD)

    @property
    def is_expected(self) -> bool:
        """Whether more may have changed than was noticed: rows were missing, or what was noticed is explained."""
        return self._state not in (State.CONTRADICTION, State.POSE_CHANGED, State.LOAD_OR_SLIP)

    @property
    def is_contradiction(self) -> bool:
        """Whether nothing has been noticed but that motions contradict each other."""
        return self._state is State.CONTRADICTION

    @property
    def is_load_certain(self) -> bool:
        """Whether the load has changed for certain, even if a grasp has slipped as well."""
        return self._state is State.LOAD_CHANGED

    @property
    def has_grounds(self) -> bool:
        """Whether anything speaks for a change: it was noticed, or rows are likelier with it."""
        return not self.is_expected or self.is_load or self.favours_change

    def notice_load(self) -> None:
        """Process that it looks like a load change now; one that shifts the load may have shown as another pose."""
        if self.is_expected:
            self._state, self._rests = State.EXPECTED_LOAD, False
        elif self._state is State.POSE_CHANGED:
            self._state, self.favours_change = State.LOAD_OR_SLIP, False

    def notice_contradiction(self) -> None:
        """Process that motions contradict each other: a load that has changed does not explain that."""
        self._contradicts, self._rests = True, False

    def notice_pose(self) -> None:
        """Process that newest rows show another pose; they are likelier with a change until causes are compared."""
        self.notice_contradiction()
        self.favours_change = True

    def contradiction_ends(self, number: int) -> None:
        """Process that motions contradict each other no longer: rows before this one may have been a sensor's fault."""
        self._leave_out_before(number)
        self._contradicts = self.favours_change = False

    def settle_load(self, number: int, is_certain: bool) -> None:
        """Process that no grasp has slipped alone; one may have slipped as well. The present load begins at the row of
        this number; if it is not certainly another one, a sensor may be faulty instead.
        """
        self._leave_out_before(number)
        self._state = State.LOAD_CHANGED if is_certain else State.EXPLAINED
        self._rests = not (self._began_after_gap or self._contradicts)

    def begin_at(self, number: int, changes: int) -> None:
        """Leave out the rows before this number, at which the present load begins, after so many other changes: after a
        gap, the load has changed once more, possibly to what it was.
        """
        self.changes = changes
        self._leave_out_before(number)
        if self._state is not State.AFTER_GAP:
            self._state = State.EXPLAINED

    def _leave_out_before(self, number: int) -> None:
        self._rows = {each: row for each, row in self._rows.items() if each >= number}
        self._first = self._oldest = number
        self._next = _LEAST

    def may_begin_at(self, number: int) -> bool:
        """Whether a change that begins at this row may be this one: not after rows that have shown no change in a gap,
        nor before the gap.
        """
        has_compared = sum(each < number for each in self._rows) >= _LEAST
        return not self.is_expected or (number >= self._first and (self.has_grounds or not has_compared))

    def add(self, number: int, row: Array) -> None:
        """Add a row; what was before a change of the load after a gap counts for nothing."""
        if number >= self._oldest:
            self._rows[number] = row

    def cause(self, known: Knowledge, guards: Guards) -> Cause | None:
        """Return the cause; None while it is not clear, or if few rows have come since the last comparison."""
        if self._rests:
            return None
        numbers, self._tried = sorted(self._rows), {}
        index = bisect_left(numbers, self._first)
        if len(numbers) - index < self._next:
            return None
        before = self._before.with_poses_of(known)
        if before is None:  # nothing can be compared yet
            return None
        self._next = math.ceil(_GROWTH * (len(numbers) - index))
        is_at_present = self.is_load_certain and known.theta is not None and not known.misses_poses
        if is_at_present:
            before = before.with_load_of(known)
        rows = np.array([self._rows[number] for number in numbers])
        ratios = partial(self._ratios, before, EvidenceAt(before.estimate.derivatives), rows)
        load, _ = _likeliest(len(numbers), index, lambda start: ratios(start).load)
        sensor, _ = _likeliest(len(numbers), index, lambda start: ratios(start).sensor)
        slip, first = _likeliest(len(numbers), index, lambda start: float(ratios(start).slips.max()))
        both, first_of_both = _likeliest(len(numbers), index, lambda start: float(ratios(start).slips_with_load.max()))
        is_load, others = both > slip + guards.lead or self.is_load_certain, max(load, sensor, 0.0)
        lead, doubtful = (both if is_load else slip) - others, max(slip, both) - others
        if self._state is State.AFTER_GAP:  # a change of the load has not been noticed yet
            doubtful = max(doubtful, load)
        if self._state is not State.POSE_CHANGED:  # then something has changed for certain
            self.favours_change = self.is_expected and doubtful > guards.doubt
        if lead <= guards.lead:
            return Cause(None, self._first, load > sensor) if max(load, sensor) > slip + guards.lead else None
        first = first_of_both if is_load else first
        each = ratios(first).of_slips(is_load)
        robot = int(each.argmax())
        if each[robot] - np.delete(each, robot).max() <= guards.doubt:
            return None
        may_be_older = not self.is_expected and each[robot] - ratios(0).of_slips(is_load)[robot] <= guards.lead
        return Cause(robot, numbers[first], is_load, bool(may_be_older))

    def _ratios(self, before: StateBeforeChange, evidence: EvidenceAt, rows: Array, start: int) -> LogRatios:
        """Return the log ratios if the row at ``start`` is the first after the change."""
        if start not in self._tried:
            moments, body = RowMoments.of(rows[start:]), before.estimate.body
            newest = evidence.of(evaluated_moments(body, moments, moments))
            with_both = self.is_expected or self._contradicts
            self._tried[start] = log_ratios(body, newest, before.covariance, before.prior.guess, with_both)
        return self._tried[start]

    def known_if_slipped(self, known: Knowledge, cause: Cause, guards: Guards) -> Knowledge | None:
        """Return the knowledge if this grasp has slipped; None if the rows do not support that.

        All rows have to fit with the slipped grasp, and have to be likelier than if only the robot's motion sensors had
        been knocked out of place: that changes their readings in the same way, but not the wrench.
        """
        assert cause.robot is not None
        before, numbers = self._before.with_poses_of(known), sorted(self._rows)
        if before is None:
            return None
        rows, start = np.array([self._rows[number] for number in numbers]), bisect_left(numbers, cause.first)
        found = _slipped(known, before, cause, numbers[start:], rows[start:])
        former = before.with_load_of(found) if cause.is_load else before
        assert found.estimate is not None
        mean = found.innovations.mean_residuals
        later = latest_start(former.estimate, found.estimate, rows, mean, guards.lead)
        if len(numbers) - max(start, later) < _LEAST:
            return None
        if later > start:
            start, found = later, _slipped(known, before, cause, numbers[later:], rows[later:])
        estimate = found.estimate
        assert estimate is not None
        former_pose, all_rows = before.estimate.state.poses[cause.robot], rows[start:]
        least = guards.doubt if cause.is_load else guards.lead  # wrenches of an unknown load show less
        if log_ratio_to_knock(estimate, cause.robot, former_pose, all_rows, cause.is_load) < least:
            return None
        return found if found.judge().outcome is Outcome.FITS else None

    @property
    def former_load(self) -> Array:
        """``theta`` before the change, shape (10,)."""
        return self._before.estimate.state.fitted_load[THETA]


def _slipped(known: Knowledge, before: StateBeforeChange, cause: Cause, numbers: list[int], rows: Array) -> Knowledge:
    """Return the knowledge from what was known before and these rows, if the grasp slipped in between."""
    assert cause.robot is not None
    prior, named = before.prior, zip(numbers, rows, strict=True)
    if before.unseen is not None:
        prior = prior.with_process_noise(slice(None), before.unseen)
    return known.slipped(prior, cause.robot, cause.is_load, named, before.past, before.estimate.hidden_poses())


def _likeliest(count: int, index: int, ratio: Callable[[int], float]) -> tuple[float, int]:
    """Return the largest log ratio over all possible first rows of ``count``, and the index of that row.

    The search begins at ``index`` and in steps.
    """
    last, step = count - _LEAST, _STEP
    best = max({index, *range(last, -1, -step)}, key=ratio)
    while step > 1:
        step = (step + 1) // 2
        best = max({best, max(best - step, 0), min(best + step, last)}, key=ratio)
    return ratio(best), best
