"""Which changes of the load and of grasps a scenario brings, and at which block."""

from __future__ import annotations

from coheft.wire.scenario.borders import first_border
from coheft.wire.scenario.checks import check_loads
from coheft.wire.scenario.schema import LoadChange, Scenario, Slip


class LoadSchedule:
    """The load changes of a scenario, in order of time.

    Raises:
        ScenarioError: They cannot all be made.
    """

    def __init__(self, scenario: Scenario) -> None:
        check_loads(scenario, scenario.name)
        self._block_duration = scenario.block_duration
        self._pending = sorted(scenario.load_changes, key=lambda change: change.at)
        self._slips = sorted(scenario.slips, key=lambda slip: slip.at)

    def due(self, block: int) -> list[LoadChange]:
        """Hand out the changes whose first block border not before their time is the start of this block."""
        due = [change for change in self._pending if first_border(change.at, self._block_duration) <= block]
        self._pending = self._pending[len(due) :]
        return due

    def slips(self, block: int) -> list[Slip]:
        """Hand out the slips that are due likewise."""
        due = [slip for slip in self._slips if first_border(slip.at, self._block_duration) <= block]
        self._slips = self._slips[len(due) :]
        return due
