"""What must hold between the keys of a scenario, beyond what their types say."""

from __future__ import annotations

import math
from collections.abc import Iterator

import msgspec
import numpy as np

from coheft.errors import ScenarioError
from coheft.wire.message_size import LARGEST, largest_message
from coheft.wire.scenario import Scenario


def check_scenario(scenario: Scenario, origin: str) -> None:
    """Check what the types cannot say; ``origin`` names the scenario's source in errors.

    Raises:
        ScenarioError: Keys contradict each other.
    """
    for place, value in _numbers(msgspec.to_builtins(scenario)):
        if not math.isfinite(value):
            raise ScenarioError(f"{origin}: key '{place}': expected a finite number; found {value!r}")
    payload = scenario.payload
    if bool(payload.boxes) == (payload.properties is not None):
        raise ScenarioError(
            f"{origin}: key 'payload': found {_both_or_neither(bool(payload.boxes), 'boxes', 'properties')}, "
            f"expected exactly one of them"
        )
    if payload.properties is not None and not np.all(np.linalg.eigvalsh(payload.inertia().pseudo_inertia()) > 0.0):
        raise ScenarioError(
            f"{origin}: key 'payload.properties.principal': found {payload.properties.principal}, but no body has a "
            f"moment of inertia larger than the sum of the two others"
        )
    robots = scenario.robots
    if robots.stiffness[1] == 0.0 and robots.damping[1] > 0.0:
        raise ScenarioError(
            f"{origin}: key 'robots.damping': found {list(robots.damping)}, expected no damping of rotations where "
            f"there is no stiffness: that is a gimbal"
        )
    if robots.arms == "seven-joint" and robots.stiffness[1] == 0.0:
        raise ScenarioError(
            f"{origin}: key 'robots.arms': found 'seven-joint' with 'robots.stiffness' = {list(robots.stiffness)}, "
            f"expected stiffness in rotation: their hands are no gimbals"
        )
    if bool(robots.grasps) == (robots.perimeter is not None):
        raise ScenarioError(
            f"{origin}: key 'robots': found {_both_or_neither(bool(robots.grasps), 'grasps', 'perimeter')}, "
            f"expected exactly one of them"
        )
    if scenario.robot_count < 2:
        raise ScenarioError(f"{origin}: key 'robots.grasps': found 1 grasp, expected at least 2")
    low, high = scenario.motion.frequency
    if low > high:
        raise ScenarioError(
            f"{origin}: key 'motion.frequency': found {[low, high]}, expected the lower frequency first"
        )
    for number, change in enumerate(scenario.load_changes):
        if (change.mass is None) == (change.remove is None):
            raise ScenarioError(
                f"{origin}: key 'load_changes[{number}]': found "
                f"{_both_or_neither(change.mass is not None, 'mass', 'remove')}, expected exactly one of them"
            )
        if change.leak > 0.0 and change.mass is None:
            raise ScenarioError(
                f"{origin}: key 'load_changes[{number}].leak': found {change.leak} without 'mass', "
                f"expected it for a new load only"
            )
    check_carry(scenario, origin)
    check_loads(scenario, origin)
    check_message_size(scenario, origin)


def check_carry(scenario: Scenario, origin: str) -> None:
    """Check that the robots can carry the payload along a common path.

    Raises:
        ScenarioError: They cannot.
    """
    carry = scenario.carry
    if carry is None:
        return
    if scenario.estimator != "efficient":
        raise ScenarioError(
            f"{origin}: key 'carry': found with 'estimator' = '{scenario.estimator}', expected 'efficient': with "
            f"others a robot knows its neighbours' poses only, not those of the whole team"
        )
    if scenario.robots.stiffness[1] == 0.0:
        raise ScenarioError(
            f"{origin}: key 'carry': found with 'robots.stiffness' = {list(scenario.robots.stiffness)}, expected "
            f"stiffness in rotation: gimbals cannot exert their share of a torque"
        )


def check_message_size(scenario: Scenario, origin: str) -> None:
    """Check that neighbours can tell each other what the sums need.

    Raises:
        ScenarioError: Their messages would be too large.
    """
    size = largest_message(scenario)
    if size <= LARGEST:
        return
    is_seed = scenario.estimator == "seed"
    other, found = ("seed_method.rounds", scenario.seed_method.rounds) if is_seed else ("robots", scenario.robot_count)
    raise ScenarioError(
        f"{origin}: key 'sensors.block': found {scenario.sensors.block}, and '{other}' = {found}: messages between "
        f"neighbours would take up to {size / 1e6:.1f} MB; expected at most {LARGEST / 1e6:.1f} MB: make one of the "
        f"two smaller"
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
    """Check that no load change is to come after the end of the run.

    A run that is made shorter than its scenario says may well leave some out.

    Raises:
        ScenarioError: One would never come.
    """
    for number, change in enumerate(scenario.load_changes):
        if change.at >= scenario.duration:
            raise ScenarioError(
                f"{origin}: key 'load_changes[{number}].at': found {change.at} s, expected a time before the end of "
                f"the run, 'duration' = {scenario.duration} s"
            )


def _both_or_neither(both: bool, one: str, other: str) -> str:
    return f"both '{one}' and '{other}'" if both else f"neither '{one}' nor '{other}'"


def _numbers(value: object, place: str = "") -> Iterator[tuple[str, float]]:
    """All floating-point numbers in nested builtins, with their keys."""
    if isinstance(value, float):
        yield place, value
    elif isinstance(value, dict):
        for key, inner in value.items():
            yield from _numbers(inner, f"{place}.{key}".lstrip("."))
    elif isinstance(value, list | tuple):
        for index, inner in enumerate(value):
            yield from _numbers(inner, f"{place}[{index}]")
