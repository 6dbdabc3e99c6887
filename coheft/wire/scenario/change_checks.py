"""What must hold for changes during a run: of the load, and of grasps that slip."""

from __future__ import annotations

from coheft.errors import ScenarioError
from coheft.wire.scenario.errors import did_you_mean
from coheft.wire.scenario.schema import Scenario


def check_slips(scenario: Scenario, origin: str) -> None:
    """Check that grasps that are to slip are there, and can.

    Raises:
        ScenarioError: One is not, or cannot.
    """
    names = scenario.robot_names
    for number, slip in enumerate(scenario.slips):
        key = f"{origin}: key 'slips[{number}]"
        if slip.robot not in names:
            raise ScenarioError(
                f"{key}.robot': found {slip.robot!r}, expected one of the robots {', '.join(names)}."
                f"{did_you_mean(slip.robot, list(names))}"
            )
        if not any((*slip.translation, *slip.rotation_deg)):
            raise ScenarioError(f"{key}': found neither 'translation' nor 'rotation_deg', expected at least one")
        if scenario.robots.arms == "seven-joint":
            raise ScenarioError(
                f"{key}': found with 'robots.arms' = 'seven-joint', expected 'springs': hands of arms with joints are "
                f"welded to the payload"
            )


def check_loads(scenario: Scenario, origin: str) -> None:
    """Check that the load changes can be made one after the other.

    Raises:
        ScenarioError: One needs a slot or a load that there will not be.
    """
    loads: list[int] = []
    total = 0
    slots = scenario.payload.load_slots
    for number, change in sorted(enumerate(scenario.load_changes), key=lambda numbered: numbered[1].at):
        if change.remove is None:
            total += 1
            loads.append(total)
        elif change.remove in loads:
            loads.remove(change.remove)
        else:
            raise ScenarioError(
                f"{origin}: key 'load_changes[{number}].remove': found {change.remove} at {change.at} s, expected one "
                f"of the loads that will be there then: {loads or 'none'}"
            )
        if len(loads) > slots:
            raise ScenarioError(
                f"{origin}: key 'load_changes[{number}]': found {len(loads)} loads at a time from {change.at} s on, "
                f"but 'payload.load_slots' is {slots}"
            )


def check_changes_come(scenario: Scenario, origin: str) -> None:
    """Check that no change of the load or of a grasp is to come after the end of the run.

    A run that is made shorter than its scenario says may well leave some out.

    Raises:
        ScenarioError: One would never come.
    """
    last = (scenario.blocks - 1) * scenario.block_duration
    changes = [("load_changes", number, change.at) for number, change in enumerate(scenario.load_changes)]
    changes += [("slips", number, slip.at) for number, slip in enumerate(scenario.slips)]
    for key, number, at in changes:
        if at > last:
            raise ScenarioError(
                f"{origin}: key '{key}[{number}].at': found {at} s, expected at most {last:g} s, when "
                f"the last block of the run begins, 'duration' = {scenario.duration} s"
            )
