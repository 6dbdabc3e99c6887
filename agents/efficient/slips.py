"""A grasp that slips: told from a load that changes, and from sensors that are off.

A small slip looks like another load at first, as torques come about another point; a large one contradicts the motion
of the team. Either way the log ratios of all that may have changed decide, see ``coheft.estimation.moments.suspects``.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from coheft.agents.efficient.knowledge import Knowledge
from coheft.agents.efficient.settings import Guards
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.misfit import worst_misfit

_SUDDEN = 2
"""Rows at the change itself are not looked at: slopes miss what jumps within a row."""
LEAST = 5
"""Rows after something was noticed from which causes are told apart: when it came is known by then."""
_LEAST_DISBELIEVED, _GROWTH = 4, 1.4
"""Rows that are not believed from which a slip is looked for, and in which steps again."""
_BEFORE = range(-30, 0, 5)
"""A slip may have come so many rows before the moment at which the load seems to have changed."""
_FRESH = 5
"""But with so many of the newest rows at least."""


class Slip(NamedTuple):
    """A grasp that slipped.

    Attributes:
        robot: Whose; its place in the team.
        first: Number of the first row after it.
        noticed: Number of the row at which something was found to have changed.
        named: Number of the row at which it was told from another load.
    """

    robot: int
    first: int
    noticed: int
    named: int


class Cause(NamedTuple):
    """What has changed.

    Attributes:
        robot: The one whose grasp has slipped, None if it is the load or a sensor.
        place: Of the first row after the change.
    """

    robot: int | None
    place: int


def cause_of(known: Knowledge, now: Estimate, place: int, guards: Guards, most: int) -> Cause | None:
    """What has changed, None while that cannot be told.

    Args:
        known: With all rows.
        now: A fit to rows before ``place``.
        place: Of the row with which the load seems to have changed.
        guards: Thresholds.
        most: From so many rows on it is the load, or a sensor, if no slip leads.
    """
    buffer = known.buffer
    rows = buffer.count - place
    if rows < LEAST:
        return None
    starts = {place} | {place + each for each in _BEFORE if buffer.start < place + each <= buffer.count - _FRESH}
    other, robot, slip, at = -np.inf, 0, -np.inf, place
    for start in sorted(starts):
        window = [buffer.rows[start:place], buffer.rows[max(start, place + _SUDDEN) : buffer.count]]
        found = known.log_ratios(now, np.concatenate(window))
        other, best = max(other, found.load, found.sensor), int(found.slips.argmax())
        if found.slips[best] > slip:
            robot, slip, at = best, float(found.slips[best]), start
    if slip > other + guards.lead:
        return Cause(robot, at)
    return Cause(None, place) if other > slip + guards.lead or rows >= most else None


class Disbelieved:
    """Rows that contradict what is known, since they began to, and whether a slip explains them."""

    def __init__(self) -> None:
        self._rows = list[tuple[int, Array]]()
        self._next = _LEAST_DISBELIEVED

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, rows: Iterable[tuple[int, Array]]) -> None:
        """Take in rows with their numbers."""
        self._rows += rows

    def slip(self, known: Knowledge, guards: Guards) -> tuple[int, list[tuple[int, Array]]] | None:
        """The robot whose grasp has slipped, and these rows in order; None if none has, or it was asked just before."""
        now = known.estimate
        if len(self) < self._next or now is None or now.misses_poses:
            return None
        self._next = round(_GROWTH * len(self))
        rows = sorted(self._rows, key=lambda each: each[0])
        robot = slip_in(known, now, np.array([row for _, row in rows[1:]]), guards)
        return None if robot is None else (robot, rows)


def slip_in(known: Knowledge, now: Estimate, rows: Array, guards: Guards) -> int | None:
    """The robot whose grasp has slipped with rows (n, X) that contradict the motion before, None if none has.

    A slip shows in motion and wrenches alike, and with the grasp elsewhere rows do fit; motion sensors that are off do
    not move wrenches.
    """
    found = known.log_ratios(now, rows)
    robot = int(found.slips.argmax())
    if found.slips[robot] < max(found.load, found.sensor) + guards.lead:
        return None
    if known.log_ratio_of_slip(now, rows, robot) < guards.lead:
        return None
    worst = worst_misfit(known.residuals_if_slipped(now, rows, robot))
    return None if worst is None or worst.chi_square > guards.largest_motion_misfit else robot
