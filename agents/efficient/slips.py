"""Distinguish a grasp that has slipped from a load that has changed, and from faulty sensors.

A small slip looks like another load at first, because torques are about another point; a large one contradicts the
motion of the team. The session reacts to both as if no grasp could slip. Meanwhile a ``Suspicion`` compares all rows
since then with what was known before, by the log ratios of ``coheft.estimation.moments.suspects``. Only a slip that is
much likelier than all other causes, and with which all rows fit, replaces what the session has found meanwhile.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from coheft.agents.efficient.judge import Outcome, judge
from coheft.agents.efficient.knowledge import Knowledge
from coheft.agents.efficient.settings import Guards
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.moments.body import FORCING, load_operator, residual_covariance
from coheft.estimation.moments.chapter import evidence_of
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.moments import RowMoments, evaluated_moments, robot_indices
from coheft.estimation.moments.suspects import LogRatios, log_ratios

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
        first: Number of the first row after the change.
    """

    robot: int | None
    first: int


class Suspicion:
    """A change whose cause is not known yet: what was known before, and all rows since.

    Args:
        known: Knowledge with all rows so far.
        index: Index in its buffer of the first row after the change, as far as is known.
        noticed: Number of the row at which it was noticed.
        changes: Number of load changes before.
        is_load: Whether it looks like a load change; if not, motions contradict each other.

    Attributes:
        noticed, changes, is_load: As given.
    """

    def __init__(self, known: Knowledge, index: int, noticed: int, changes: int, is_load: bool) -> None:
        buffer = known.buffer
        begin = max(index - _BEFORE, (buffer.start + index) // 2)
        self._now, self._prior = known.known_before(begin)
        self._covariance = known.covariance_now(self._now)
        self._past = known.innovations.past_before_slip
        numbers = buffer.numbers[begin : buffer.count].tolist()
        self._rows = dict(zip(numbers, buffer.window(begin).copy(), strict=True))
        self._first = numbers[index - begin] if index < buffer.count else noticed
        self._next, self._tried = _LEAST, dict[int, LogRatios]()
        self.noticed, self.changes, self.is_load = noticed, changes, is_load

    def add(self, number: int, row: Array) -> None:
        """Add a row."""
        self._rows[number] = row

    def cause(self, guards: Guards) -> Cause | None:
        """Return the cause; None while it is not clear, or if few rows have come since the last comparison."""
        numbers, self._tried = sorted(self._rows), {}
        index = bisect_left(numbers, self._first)
        if len(numbers) - index < self._next:
            return None
        self._next = math.ceil(_GROWTH * (len(numbers) - index))
        rows = np.array([self._rows[number] for number in numbers])
        load, _ = self._likeliest(rows, index, lambda found: found.load)
        sensor, _ = self._likeliest(rows, index, lambda found: found.sensor)
        slip, first = self._likeliest(rows, index, lambda found: float(found.slips.max()))
        if slip > max(load, sensor) + guards.lead:
            return Cause(int(self._ratios(rows, first).slips.argmax()), numbers[first])
        return Cause(None, self._first) if max(load, sensor) > slip + guards.lead else None

    def _likeliest(self, rows: Array, index: int, ratio: Callable[[LogRatios], float]) -> tuple[float, int]:
        """Return the largest log ratio over all possible first rows, and the index of that row."""

        def at(start: int) -> float:
            return ratio(self._ratios(rows, start))

        last, step = len(rows) - _LEAST, _STEP
        best = max({index, *range(last, -1, -step)}, key=at)
        while step > 1:
            step = (step + 1) // 2
            best = max({best, max(best - step, 0), min(best + step, last)}, key=at)
        return at(best), best

    def _ratios(self, rows: Array, start: int) -> LogRatios:
        """Return the log ratios if the row at ``start`` is the first after the change."""
        if start not in self._tried:
            body, moments = self._now.body, RowMoments.of(rows[start:])
            newest = evidence_of(body, evaluated_moments(body, moments, moments))
            self._tried[start] = log_ratios(body, newest, self._covariance, self._prior.guess)
        return self._tried[start]

    def known_if_slipped(self, known: Knowledge, cause: Cause, guards: Guards, has_offset: bool) -> Knowledge | None:
        """Return the knowledge if this grasp has slipped; None if the rows do not support that.

        All rows have to fit with the slipped grasp, and have to be likelier than if only the robot's motion sensors had
        been knocked out of place: that changes their readings in the same way, but not the wrench.
        """
        assert cause.robot is not None
        numbers = [number for number in sorted(self._rows) if number >= cause.first]
        rows = [(number, self._rows[number]) for number in numbers]
        found = known.slipped(self._prior, cause.robot, rows, self._past)
        estimate = found.estimate
        assert estimate is not None
        former_pose = self._now.state.poses[cause.robot]
        if _log_ratio_to_knock(estimate, cause.robot, former_pose, np.array([row for _, row in rows])) < guards.lead:
            return None
        verdict = judge(estimate, found.innovations, found.buffer, guards, None, has_offset, found.drift)
        return found if verdict.outcome is Outcome.FITS else None


def _log_ratio_to_knock(estimate: Estimate, robot: int, former_pose: Pose, rows: Array) -> float:
    """Return the log ratio of the wrenches of rows (n, X): slipped grasp to grasp as before."""
    body, load = estimate.body, estimate.state.load
    assert load is not None
    root = np.linalg.cholesky(residual_covariance(body, load))
    needed, own = load_operator(load) @ body.motion_map[FORCING], robot_indices(body.count, body.unknowns.errors)[robot]
    to_former = former_pose.adjoint() @ estimate.state.poses[robot].inverse().adjoint()
    knocked = body.wrench_map.copy()
    knocked[:, own] = to_former @ knocked[:, own]
    of_slip, of_knock = (np.linalg.solve(root, (each - needed) @ rows.T) for each in (body.wrench_map, knocked))
    return 0.5 * float(np.square(of_knock).sum() - np.square(of_slip).sum())
