"""Rules for changes during a run: of the load, and of grasps that slip."""

from collections.abc import Iterator

from coheft.wire.scenario.errors import did_you_mean
from coheft.wire.scenario.rules import Complaint, exactly_one
from coheft.wire.scenario.schema import LoadChange, Scenario


def slip_complaints(scenario: Scenario) -> Iterator[Complaint]:
    """Complain about grasps that are to slip, and are not there or cannot."""
    names = scenario.robot_names
    for number, slip in enumerate(scenario.slips):
        key = f"slips[{number}]"
        if slip.robot not in names:
            hint = did_you_mean(slip.robot, list(names))
            yield f"{key}.robot", f"found {slip.robot!r}, expected one of the robots {', '.join(names)}.{hint}"
        if not any((*slip.translation, *slip.rotation_deg)):
            yield key, "found neither 'translation' nor 'rotation_deg', expected at least one"
        if scenario.robots.arms == "seven-joint":
            yield (
                key,
                "found with 'robots.arms' = 'seven-joint', expected 'springs': hands of arms with joints are welded "
                "to the payload",
            )


def load_complaints(scenario: Scenario) -> Iterator[Complaint]:
    """Complain about load changes that are ambiguous, or need a slot or a load that there will not be."""
    slots = scenario.payload.load_slots
    for number, change, there in loads_over_time(scenario):
        key = f"load_changes[{number}]"
        yield from exactly_one(change, ("mass", "remove"), key)
        if change.leak > 0.0 and change.mass is None:
            yield f"{key}.leak", f"found {change.leak} without 'mass', expected it for a new load only"
        if change.remove is not None and change.remove not in there:
            yield (
                f"{key}.remove",
                f"found {change.remove} at {change.at} s, expected one of the loads that will be there then: "
                f"{list(there) or 'none'}",
            )
        if change.remove is None and len(there) >= slots:
            found = f"found {len(there) + 1} loads at a time from {change.at} s on"
            yield key, f"{found}, but 'payload.load_slots' is {slots}; set it to at least {len(there) + 1}"


def loads_over_time(scenario: Scenario) -> Iterator[tuple[int, LoadChange, dict[int, LoadChange]]]:
    """Yield the changes of the load in order of time: index, change, and by number the loads before it."""
    there: dict[int, LoadChange] = {}
    count = 0
    for index, change in sorted(enumerate(scenario.load_changes), key=lambda each: each[1].at):
        yield index, change, there
        if change.remove is not None:
            there.pop(change.remove, None)
        else:
            count += 1
            there[count] = change


def late_change_complaints(scenario: Scenario) -> Iterator[Complaint]:
    """Complain about changes of the load or of a grasp after the end of the run.

    A run that is made shorter than its scenario says may well leave some out.
    """
    for key, at in late_changes(scenario):
        yield (
            f"{key}.at",
            f"found {at} s, expected at most {_last_start(scenario):g} s, when the last block of the run begins, "
            f"'duration' = {scenario.duration} s",
        )


def late_changes(scenario: Scenario) -> list[tuple[str, float]]:
    """Return the changes after the start of the last block, which take no effect: their keys and times [s]."""
    changes = [(f"load_changes[{number}]", change.at) for number, change in enumerate(scenario.load_changes)]
    changes += [(f"slips[{number}]", slip.at) for number, slip in enumerate(scenario.slips)]
    return [(key, at) for key, at in changes if at > _last_start(scenario)]


def _last_start(scenario: Scenario) -> float:
    return (scenario.blocks - 1) * scenario.block_duration
