"""Schedules of faults with some values that are set instead of drawn."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from coheft.app.faults.schedule import FaultSchedule
from coheft.errors import ScenarioError
from coheft.wire.scenario.file import scenario_of
from coheft.wire.scenario.set_values import set_values

_DRAWN = ("robots", "graph", "duration", "seed")
"""Keys that may not be set, because faults refer to robots, links and times."""


def with_values(schedule: FaultSchedule, values: Sequence[str]) -> FaultSchedule:
    """Set values of a drawn schedule, see ``coheft.wire.scenario.set_values``.

    Raises:
        ScenarioError: A value is invalid, or changes the robots or links that faults refer to.
    """
    drawn = schedule.scenario
    origin = f"{drawn.name} with {' '.join(f'--set {value}' for value in values)}"
    table = msgspec.json.decode(msgspec.json.encode(drawn))
    set_values(table, values)
    chosen = scenario_of(table, origin)
    for key in _DRAWN:
        if getattr(chosen, key) != getattr(drawn, key):
            raise ScenarioError(f"{origin}: key '{key}' is drawn together with the faults: leave it out")
    return msgspec.structs.replace(schedule, scenario=chosen)
