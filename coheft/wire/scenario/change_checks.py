"""Rules for changes during a run: of the load, and of grasps that slip."""

from collections.abc import Iterator

from coheft.wire.scenario.errors import did_you_mean
from coheft.wire.scenario.rules import Complaint, exactly_one
from coheft.wire.scenario.schema import Scenario


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
    loads: list[int] = []
    total = 0
    slots = scenario.payload.load_slots
    for number, change in sorted(enumerate(scenario.load_changes), key=lambda numbered: numbered[1].at):
        key = f"load_changes[{number}]"
        yield from exactly_one(change, ("mass", "remove"), key)
        if change.leak > 0.0 and change.mass is None:
            yield f"{key}.leak", f"found {change.leak} without 'mass', expected it for a new load only"
        if change.remove is None:
            total += 1
            loads.append(total)
        elif change.remove in loads:
            loads.remove(change.remove)
        else:
            there = loads or "none"
            yield (
                f"{key}.remove",
                f"found {change.remove} at {change.at} s, expected one of the loads that will be there then: {there}",
            )
        if len(loads) > slots:
            found = f"found {len(loads)} loads at a time from {change.at} s on"
            yield key, f"{found}, but 'payload.load_slots' is {slots}"


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
