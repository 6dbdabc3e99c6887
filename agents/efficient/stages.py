"""Stages of a robot's knowledge of the load, and the transitions between them."""

from __future__ import annotations

from enum import Enum


class Stage(Enum):
    """What a session knows of the load."""

    GATHERING = "gathering rows of a load that is not known yet"
    UNDECIDED = "either the load has changed or a sensor has an offset"
    ESTIMATING = "the load is known"


class Event(Enum):
    """Events that cause transitions between stages."""

    FITTED = "a load has been fitted"
    UNDECIDED = "a load has been fitted, but a sensor that has an offset explains wrenches as well"
    LOAD_CHANGED = "the load is another one"
    MISFIT = "wrenches do not fit the load that was fitted to them"
    SLIPPED = "a grasp has slipped; the load is known with it"
    STARTED_OVER = (
        "all is forgotten: motions fit no poses, errors of sensors no tolerances, or for long rows fit no load,"
        " contradict each other, or leave in doubt what has changed"
    )
    EXCEEDED = "all is forgotten, and what was known before, too: errors of sensors exceed tolerances again"


TRANSITIONS = {
    (Stage.GATHERING, Event.FITTED): Stage.ESTIMATING,
    (Stage.GATHERING, Event.UNDECIDED): Stage.UNDECIDED,
    (Stage.GATHERING, Event.MISFIT): Stage.GATHERING,
    (Stage.GATHERING, Event.SLIPPED): Stage.ESTIMATING,
    (Stage.GATHERING, Event.STARTED_OVER): Stage.GATHERING,
    (Stage.GATHERING, Event.EXCEEDED): Stage.GATHERING,
    (Stage.UNDECIDED, Event.FITTED): Stage.ESTIMATING,
    (Stage.UNDECIDED, Event.UNDECIDED): Stage.UNDECIDED,
    (Stage.UNDECIDED, Event.LOAD_CHANGED): Stage.GATHERING,
    (Stage.UNDECIDED, Event.MISFIT): Stage.GATHERING,
    (Stage.UNDECIDED, Event.SLIPPED): Stage.ESTIMATING,
    (Stage.UNDECIDED, Event.STARTED_OVER): Stage.GATHERING,
    (Stage.UNDECIDED, Event.EXCEEDED): Stage.GATHERING,
    (Stage.ESTIMATING, Event.FITTED): Stage.ESTIMATING,
    (Stage.ESTIMATING, Event.LOAD_CHANGED): Stage.GATHERING,
    (Stage.ESTIMATING, Event.MISFIT): Stage.GATHERING,
    (Stage.ESTIMATING, Event.SLIPPED): Stage.ESTIMATING,
    (Stage.ESTIMATING, Event.STARTED_OVER): Stage.GATHERING,
    (Stage.ESTIMATING, Event.EXCEEDED): Stage.GATHERING,
}
"""All that can happen; anything else is an error in this file."""
