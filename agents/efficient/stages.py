"""Stages of a robot's knowledge of the load, the events that lead to them; whether loads are forgotten too often."""

from __future__ import annotations

from enum import Enum

from coheft.agents.efficient.settings import RowCounts


class Stage(Enum):
    """What a session knows of the load."""

    GATHERING = "gathering rows of a load that is not known yet"
    UNDECIDED = "either the load has changed or a sensor has an offset"
    ESTIMATING = "the load is known"


class Event(Enum):
    """Events that determine the stage."""

    FITTED = "a load has been fitted"
    UNDECIDED = "a load has been fitted, but a sensor that has an offset explains wrenches as well"
    LOAD_CHANGED = "the load is another one"
    MISFIT = "wrenches do not fit the load that was fitted to them"
    POSE_CHANGED = "a load has been fitted, but newest rows show another pose of a grasp than all before"
    SLIPPED = "a grasp has slipped; the load is known with it"
    STARTED_OVER = (
        "all is forgotten: motions fit no poses, errors of sensors no tolerances, or for long rows fit no load,"
        " contradict each other, or leave in doubt what has changed or when"
    )


STAGE_AFTER = {
    Event.FITTED: Stage.ESTIMATING,
    Event.UNDECIDED: Stage.UNDECIDED,
    Event.LOAD_CHANGED: Stage.GATHERING,
    Event.MISFIT: Stage.GATHERING,
    Event.POSE_CHANGED: Stage.ESTIMATING,
    Event.SLIPPED: Stage.ESTIMATING,
    Event.STARTED_OVER: Stage.GATHERING,
}
"""The stage after each event, whatever the stage was before."""


class ResetMonitor:
    """Remembers when loads were forgotten: if soon again (``rows.calm``) and for long (``rows.restless``), poses may be
    wrong.
    """

    def __init__(self, rows: RowCounts) -> None:
        self._rows, self._last = rows, -rows.calm
        self._since: int | None = None  # when the first of the loads was forgotten

    def forget_load(self, number: int, was_known: bool) -> bool:
        """A load is forgotten at this row; return whether that has been so for too long."""
        is_again = not was_known or number - self._last < self._rows.calm
        if self._since is None or not is_again:
            self._since = number
        self._last = number
        return is_again and number - self._since > self._rows.restless
