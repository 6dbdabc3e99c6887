"""Which load changes a scenario brings, and at which block."""

from __future__ import annotations

from collections.abc import Sequence

from coheft.errors import ScenarioError
from coheft.wire.scenario import LoadChange, Scenario


class LoadSchedule:
    """The load changes of a scenario, in order of time.

    Raises:
        ScenarioError: They cannot all be made.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._block_duration = scenario.block_duration
        self._pending = sorted(scenario.load_changes, key=lambda change: change.at)
        _check(self._pending, scenario.payload.load_slots)

    def due(self, block: int) -> list[LoadChange]:
        """Hand out the changes whose first block border not before their time is the start of this block."""
        start = block * self._block_duration + 1e-9  # borders are multiples of a rounded number
        due = [change for change in self._pending if change.at <= start]
        self._pending = self._pending[len(due) :]
        return due


def _check(changes: Sequence[LoadChange], slots: int) -> None:
    """Check that load changes, in order of time, can be made.

    Raises:
        ScenarioError: One needs a slot or a load that there will not be.
    """
    loads: list[int] = []
    total = 0
    for change in changes:
        if change.remove is None:
            total += 1
            loads.append(total)
        elif change.remove in loads:
            loads.remove(change.remove)
        else:
            raise ScenarioError(
                f"key 'load_changes': found remove = {change.remove} at {change.at} s, expected one of the loads that "
                f"will be there then: {loads or 'none'}"
            )
        if len(loads) > slots:
            raise ScenarioError(
                f"key 'load_changes': found {len(loads)} loads at a time from {change.at} s on, but "
                f"'payload.load_slots' is {slots}"
            )
