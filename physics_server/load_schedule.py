"""The scenario's changes of the load and slips of grasps, by block."""

from coheft.wire.scenario.borders import first_border
from coheft.wire.scenario.change_checks import load_complaints
from coheft.wire.scenario.rules import check
from coheft.wire.scenario.schema import LoadChange, Scenario, Slip


class LoadSchedule:
    """The load changes and slips of a scenario, by time; raises ``ScenarioError`` if some cannot be made."""

    def __init__(self, scenario: Scenario) -> None:
        check(scenario, scenario.name, load_complaints)
        self._block_duration = scenario.block_duration
        self._pending = sorted(scenario.load_changes, key=lambda change: change.at)
        self._slips = sorted(scenario.slips, key=lambda slip: slip.at)

    def due(self, block: int) -> list[LoadChange]:
        """Remove and return the load changes that are due at the start of this block."""
        due = [change for change in self._pending if first_border(change.at, self._block_duration) <= block]
        self._pending = self._pending[len(due) :]
        return due

    def slips(self, block: int) -> list[Slip]:
        """Remove and return the slips that are due at the start of this block."""
        due = [slip for slip in self._slips if first_border(slip.at, self._block_duration) <= block]
        self._slips = self._slips[len(due) :]
        return due
