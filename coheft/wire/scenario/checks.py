"""What must hold between the keys of a scenario, beyond what their types say."""

from __future__ import annotations

import math

import msgspec
import numpy as np

from coheft.errors import ScenarioError
from coheft.estimation.measurement import SensorNoise
from coheft.wire.messages.size import LARGEST, largest_message
from coheft.wire.scenario.arm_checks import check_arms
from coheft.wire.scenario.change_checks import check_loads, check_slips
from coheft.wire.scenario.grasps import place_grasps
from coheft.wire.scenario.motion_checks import check_motion
from coheft.wire.scenario.payload_extent import check_load_places
from coheft.wire.scenario.payload_surface import from_text
from coheft.wire.scenario.plugin_checks import check_plugins, leaves
from coheft.wire.scenario.plugins import estimator_names
from coheft.wire.scenario.robot_sensors import check_named
from coheft.wire.scenario.schema import Scenario

_MOST_ROBOTS = 128
"""Of a team in which each robot estimates all poses: a fit takes half a second there."""
_LEAST_NOISE = 1e-3
"""In units of the nominal noise."""
_LEVEL = 1e-9
"""A frame counts as level if its vertical is off by less than this."""


def check_scenario(scenario: Scenario, origin: str) -> None:
    """Check what the types cannot say; ``origin`` names the scenario's source in errors.

    Raises:
        ScenarioError: Keys contradict each other.
    """
    check_choices(scenario, origin)
    payload = scenario.payload
    if payload.properties is not None and not np.all(np.linalg.eigvalsh(payload.inertia().pseudo_inertia()) > 0.0):
        raise ScenarioError(
            f"{origin}: key 'payload.properties.principal': found {list(payload.properties.principal)}, but no body "
            f"has a moment of inertia larger than the sum of the two others"
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
    if scenario.robot_count < 2:
        raise ScenarioError(f"{origin}: key 'robots.grasps': found 1 grasp, expected at least 2")
    if scenario.motion.own is not None and scenario.motion.via_points is not None:
        raise ScenarioError(f"{origin}: key 'motion': found both 'via_points' and 'own', expected one of them at most")
    check_plugins(scenario, origin)
    low, high = scenario.motion.frequency
    if low > high:
        raise ScenarioError(
            f"{origin}: key 'motion.frequency': found {[low, high]}, expected the lower frequency first"
        )
    for name in ("transit", "dwell") if scenario.motion.via_points is not None else ():
        shortest, longest = getattr(scenario.motion.via_points, name)
        if shortest > longest:
            raise ScenarioError(
                f"{origin}: key 'motion.via_points.{name}': found {[shortest, longest]}, expected the shorter one first"
            )
    for number, change in enumerate(scenario.load_changes):
        _check_one_of(change, ("mass", "remove"), f"load_changes[{number}]", origin)
        if change.leak > 0.0 and change.mass is None:
            raise ScenarioError(
                f"{origin}: key 'load_changes[{number}].leak': found {change.leak} without 'mass', "
                f"expected it for a new load only"
            )
    check_slips(scenario, origin)
    check_named(scenario.sensors.of, scenario.robot_names, f"{origin}: key")
    check_noise(scenario, origin)
    check_carry(scenario, origin)
    check_encoders(scenario, origin)
    check_motion(scenario, origin)
    check_loads(scenario, origin)
    check_load_places(scenario, origin)
    check_arms(scenario, origin)
    check_message_size(scenario, origin)
    check_team_size(scenario, origin)


def check_noise(scenario: Scenario, origin: str) -> None:
    """Check that sensors are not so good that nothing else is.

    Raises:
        ScenarioError: They are.
    """
    sensors = scenario.sensors
    for name in SensorNoise.__struct_fields__:
        least = _LEAST_NOISE * getattr(SensorNoise(), name)
        if not least <= getattr(scenario.noise, name) < math.inf:
            raise ScenarioError(
                f"{origin}: key 'sensors.noise.{name}': found {getattr(sensors.noise, name):g}, times "
                f"'sensors.noise_scale' = {sensors.noise_scale:g}, expected at least {least:g} in all: with "
                f"less, rounding and the time between samples would count for more than the noise"
            )
        for number, (robot, own) in enumerate(sensors.unequal().items()):
            if not least <= getattr(own.noise, name) < math.inf:
                raise ScenarioError(
                    f"{origin}: key 'sensors.of[{number}]': found noise of the {name} of {robot} of "
                    f"{getattr(own.noise, name):g} with all factors, expected at least {least:g}"
                )


def check_carry(scenario: Scenario, origin: str) -> None:
    """Check that the robots can carry the payload along a common path.

    Raises:
        ScenarioError: They cannot.
    """
    carry = scenario.carry
    if carry is None:
        return
    if estimator_names(scenario.estimator)[0] != "efficient":
        raise ScenarioError(
            f"{origin}: key 'carry': found with 'estimator' = '{scenario.estimator}', expected 'efficient': with "
            f"others a robot knows its neighbours' poses only, not those of the whole team"
        )
    if scenario.robots.stiffness[1] == 0.0:
        raise ScenarioError(
            f"{origin}: key 'carry': found with 'robots.stiffness' = {list(scenario.robots.stiffness)}, expected "
            f"stiffness in rotation: gimbals cannot exert their share of a torque"
        )


def check_encoders(scenario: Scenario, origin: str) -> None:
    """Check that wrists with encoders record all that matters: gimbals transmit no torque, and home frames are level.

    What pushes with a torque needs stiffness in rotation (``check_carry``), so do damping and arms of seven joints.

    Raises:
        ScenarioError: A recording would leave torques out, or have gravity point elsewhere.
    """
    if scenario.sensors.encoders is None:
        return
    for number, each in enumerate(scenario.sensors.of):
        if each.missing:
            raise ScenarioError(
                f"{origin}: key 'sensors.of[{number}].missing': found with 'sensors.encoders', expected none: such "
                f"recordings have the wrenches of all robots"
            )
    if scenario.robots.stiffness[1] > 0.0:
        raise ScenarioError(
            f"{origin}: key 'sensors.encoders': found with 'robots.stiffness' = {list(scenario.robots.stiffness)}, "
            f"expected no stiffness in rotation: such wrists are gimbals, and record no torque"
        )
    for name, grasp in zip(scenario.robot_names, place_grasps(scenario), strict=True):
        off = float(np.linalg.norm(grasp.rotation[2] - [0.0, 0.0, 1.0]))
        if off >= _LEVEL:
            tilt = math.degrees(2.0 * math.asin(min(1.0, 0.5 * off)))
            raise ScenarioError(
                f"{origin}: key 'sensors.encoders': found with a grasp of {name} that is tilted by {tilt:.3g}°, "
                f"expected 'robots.grasps' turned about the vertical only: home frames must be level, as recordings "
                f"have gravity along their z axes"
            )


def check_choices(scenario: Scenario, origin: str) -> None:
    """Check that numbers are finite, and that of keys that exclude each other one is there, before files are read.

    Raises:
        ScenarioError: They are not, or it is not.
    """
    for place, value in leaves(msgspec.to_builtins(scenario)):
        if isinstance(value, float) and not math.isfinite(value):
            raise ScenarioError(f"{origin}: key '{place}': expected a finite number; found {value!r}")
    payload, robots = scenario.payload, scenario.robots
    _check_one_of(payload, ("boxes", "properties", "mjcf", "mesh"), "payload", origin)
    _check_one_of(robots, ("grasps", "perimeter", "sites"), "robots", origin)
    if payload.mesh is not None:
        _check_one_of(payload, ("mass", "density"), "payload", origin)
    try:
        from_text(payload.surface)
    except ValueError as error:
        raise ScenarioError(f"{origin}: key 'payload.surface': {error}; leave it out: coheft fills it in") from error
    needs = {"body": "mjcf", "density": "mesh", "mass": "mesh"}
    for key, needed in needs.items():
        if getattr(payload, key) is not None and getattr(payload, needed) is None:
            raise ScenarioError(
                f"{origin}: key 'payload.{key}': found it without 'payload.{needed}', of which it tells"
            )
    if payload.scale != 1.0 and payload.mesh is None:
        raise ScenarioError(f"{origin}: key 'payload.scale': found it without 'payload.mesh', of which it tells")
    if robots.sites and payload.mjcf is None:
        raise ScenarioError(
            f"{origin}: key 'robots.sites': found {', '.join(robots.sites)}, but only a model has sites: expected "
            f"'payload.mjcf', or 'robots.grasps' instead"
        )


def _check_one_of(section: msgspec.Struct, keys: tuple[str, ...], place: str, origin: str) -> None:
    """Check that exactly one of some keys is given."""
    given = [f"'{key}'" for key in keys if getattr(section, key) not in (None, ())]
    if len(given) == 1:
        return
    found = f"both {' and '.join(given)}" if given else f"neither {' nor '.join(repr(key) for key in keys)}"
    raise ScenarioError(f"{origin}: key '{place}': found {found}, expected exactly one of them")


def check_message_size(scenario: Scenario, origin: str) -> None:
    """Check that neighbours can tell each other what the sums need.

    Raises:
        ScenarioError: Their messages would be too large.
    """
    size = largest_message(scenario)
    if size <= LARGEST:
        return
    is_fan2017 = "fan2017" in estimator_names(scenario.estimator)
    other, found = ("fan2017.rounds", scenario.fan2017.rounds) if is_fan2017 else ("robots", scenario.robot_count)
    raise ScenarioError(
        f"{origin}: key 'sensors.block': found {scenario.sensors.block}, and '{other}' = {found}: messages between "
        f"neighbours would take up to {size / 1e6:.1f} MB; expected at most {LARGEST / 1e6:.1f} MB: make one of the "
        f"two smaller"
    )


def check_team_size(scenario: Scenario, origin: str) -> None:
    """Check that robots are not too many for an estimator in which each of them knows the whole team.

    Raises:
        ScenarioError: They are.
    """
    if "efficient" in estimator_names(scenario.estimator) and scenario.robot_count > _MOST_ROBOTS:
        raise ScenarioError(
            f"{origin}: key 'robots': found {scenario.robot_count} with 'estimator' = 'efficient', expected at most "
            f"{_MOST_ROBOTS}: there each robot finds the poses of all; memory grows as N², fits as N³ "
            f"(docs/wide.md). With 'fan2017' it finds those of its neighbours only"
        )
