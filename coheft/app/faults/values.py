"""Schedules of faults with some values that are not drawn."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from coheft.app.faults.schedule import FaultSchedule
from coheft.errors import ScenarioError
from coheft.wire.scenario.file import scenario_of
from coheft.wire.scenario.set_values import set_values

_DRAWN = ("robots", "graph", "duration", "seed")
"""Keys that faults are about: robots and links by their names, times."""


def with_values(schedule: FaultSchedule, values: Sequence[str]) -> FaultSchedule:
    """A drawn schedule with some values that were not drawn, see ``coheft.wire.scenario.set_values``.

    Raises:
        ScenarioError: A value cannot be used, or changes whom the faults are about.
    """
    drawn = schedule.scenario
    origin = f"{drawn.name} with {' '.join(f'--set {value}' for value in values)}"
    table = msgspec.json.decode(msgspec.json.encode(drawn))
    set_values(table, values)
    chosen = scenario_of(table, origin)
    for key in _DRAWN:
        if getattr(chosen, key) != getattr(drawn, key):
            raise ScenarioError(f"{origin}: key '{key}': it is drawn with the faults, which are about it; leave it out")
    return msgspec.structs.replace(schedule, scenario=chosen)
