"""A grasp that slips: told from a load that changes, and from sensors that are off.

A small slip looks like another load at first, as torques come about another point; a large one contradicts the motion
of the team. Either way what is done about these goes on as if no grasp could slip. Beside it, all rows since then are
compared with what was known before, by the log ratios of ``coheft.estimation.moments.suspects``. Only a slip that
leads, and with which all rows fit, takes the place of what has been found meanwhile.
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
from coheft.estimation.moments.moments import RowMoments, evaluated_moments, robot_places
from coheft.estimation.moments.suspects import LogRatios, log_ratios

_LEAST, _GROWTH = 5, 1.5
"""Rows from which causes are told apart first, and in which steps again: when it came is known by then."""
_BEFORE, _STEP = 30, 8
"""It may have come so many rows before it was noticed. Which row was the first is sought in such steps, then finer."""


class Slip(NamedTuple):
    """A grasp that slipped.

    Attributes:
        robot: Whose; its place in the team.
        first: Number of the first row after it.
        noticed: Number of the row at which something was found to have changed.
        named: Number of the row at which it was told from all else.
    """

    robot: int
    first: int
    noticed: int
    named: int


class Cause(NamedTuple):
    """What has changed.

    Attributes:
        robot: The one whose grasp has slipped, None if it is the load or a sensor.
        first: Number of the first row after the change.
    """

    robot: int | None
    first: int


class Suspicion:
    """That something has changed, with what was known before, and all rows since.

    Args:
        known: With all rows so far.
        place: Of the first row after the change, as far as is known.
        noticed: Number of the row at which it was noticed.
        changes: Of the load that were known before.
        is_load: Whether it looks like another load; if not, motions contradict each other.

    Attributes:
        noticed: Likewise.
        changes: Likewise.
        is_load: Likewise.
    """

    def __init__(self, known: Knowledge, place: int, noticed: int, changes: int, is_load: bool) -> None:
        buffer = known.buffer
        begin = max(place - _BEFORE, (buffer.start + place) // 2)
        self._now, self._prior = known.before(begin)
        self._covariance = known.covariance_now(self._now)
        self._innovations = known.innovations
        numbers = buffer.numbers[begin : buffer.count].tolist()
        self._rows = dict(zip(numbers, buffer.window(begin).copy(), strict=True))
        self._first = numbers[place - begin] if place < buffer.count else noticed
        self._next, self._tried = _LEAST, dict[int, LogRatios]()
        self.noticed, self.changes, self.is_load = noticed, changes, is_load

    def add(self, number: int, row: Array) -> None:
        """Take in a row, the first one as well as any other."""
        self._rows[number] = row

    def cause(self, guards: Guards) -> Cause | None:
        """What has changed; None while that cannot be told, or if rows are hardly more than the last time."""
        numbers, self._tried = sorted(self._rows), {}
        place = bisect_left(numbers, self._first)
        if len(numbers) - place < self._next:
            return None
        self._next = math.ceil(_GROWTH * (len(numbers) - place))
        rows = np.array([self._rows[number] for number in numbers])
        load, _ = self._likeliest(rows, place, lambda found: found.load)
        sensor, _ = self._likeliest(rows, place, lambda found: found.sensor)
        slip, first = self._likeliest(rows, place, lambda found: float(found.slips.max()))
        if slip > max(load, sensor) + guards.lead:
            return Cause(int(self._ratios(rows, first).slips.argmax()), numbers[first])
        return Cause(None, self._first) if max(load, sensor) > slip + guards.lead else None

    def _likeliest(self, rows: Array, place: int, ratio: Callable[[LogRatios], float]) -> tuple[float, int]:
        """The largest log ratio wherever the change may have been, and at which place: first roughly, then exactly."""

        def at(start: int) -> float:
            return ratio(self._ratios(rows, start))

        last, step = len(rows) - _LEAST, _STEP
        best = max({place, *range(last, -1, -step)}, key=at)
        while step > 1:
            step = (step + 1) // 2
            best = max({best, max(best - step, 0), min(best + step, last)}, key=at)
        return at(best), best

    def _ratios(self, rows: Array, start: int) -> LogRatios:
        """If the first of these rows after the change is that at a place."""
        if start not in self._tried:
            body, moments = self._now.body, RowMoments.of(rows[start:])
            newest = evidence_of(body, evaluated_moments(body, moments, moments))
            self._tried[start] = log_ratios(body, newest, self._covariance, self._prior.guess)
        return self._tried[start]

    def known_if_slipped(self, known: Knowledge, cause: Cause, guards: Guards, has_offset: bool) -> Knowledge | None:
        """What is known if this grasp has slipped; None if rows do not bear it out.

        With the grasp elsewhere all rows have to fit, and they have to be likelier than if only the robot's motion
        sensors had been knocked, which moves what these read in the same way, but not the wrench.
        """
        assert cause.robot is not None
        numbers = [number for number in sorted(self._rows) if number >= cause.first]
        rows = [(number, self._rows[number]) for number in numbers]
        found = known.slipped(self._prior, cause.robot, rows, self._innovations)
        estimate = found.estimate
        assert estimate is not None
        before = self._now.state.poses[cause.robot]
        if _log_ratio_to_knock(estimate, cause.robot, before, np.array([row for _, row in rows])) < guards.lead:
            return None
        verdict = judge(estimate, found.innovations, found.buffer, guards, None, has_offset)
        return found if verdict.outcome is Outcome.FITS else None


def _log_ratio_to_knock(estimate: Estimate, robot: int, before: Pose, rows: Array) -> float:
    """How much likelier the wrenches of rows (n, X) are than if the grasp were where it was before, as a logarithm."""
    body, load = estimate.body, estimate.state.load
    assert load is not None
    root = np.linalg.cholesky(residual_covariance(body, load))
    needed, own = load_operator(load) @ body.motion_map[FORCING], robot_places(body.count, body.unknowns.errors)[robot]
    to_before = before.adjoint() @ estimate.state.poses[robot].inverse().adjoint()
    knocked = body.wrench_map.copy()
    knocked[:, own] = to_before @ knocked[:, own]
    of_slip, of_knock = (np.linalg.solve(root, (each - needed) @ rows.T) for each in (body.wrench_map, knocked))
    return 0.5 * float(np.square(of_knock).sum() - np.square(of_slip).sum())
