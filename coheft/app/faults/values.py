"""Schedules of faults with some values that are set instead of drawn."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from coheft.app.faults.schedule import FaultSchedule
from coheft.errors import ScenarioError
from coheft.wire.scenario import file

_DRAWN = ("robots", "graph", "duration", "seed")
"""Keys that may not be set, because faults refer to robots, links and times."""


def with_values(schedule: FaultSchedule, values: Sequence[str]) -> FaultSchedule:
    """Set values of a drawn schedule, see ``coheft.wire.scenario.set_values``.

    Raises:
        ScenarioError: A value is invalid, or changes the robots or links that faults refer to.
    """
    chosen = file.with_values(schedule.scenario, values)
    for key in _DRAWN:
        if getattr(chosen, key) != getattr(schedule.scenario, key):
            raise ScenarioError(f"{chosen.name}: key '{key}' is drawn together with the faults: leave it out")
    return msgspec.structs.replace(schedule, scenario=chosen)
