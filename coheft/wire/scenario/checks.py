"""The rules of a scenario that concern several of its keys, and the list of all rules."""

import math
from collections.abc import Iterator

import msgspec
import numpy as np

from coheft.estimation.measurement import SensorNoise
from coheft.estimation.tolerance import MOTION_SENSORS
from coheft.wire.messages.size import LARGEST, largest_message
from coheft.wire.scenario.arm_checks import arm_complaints
from coheft.wire.scenario.change_checks import load_complaints, slip_complaints
from coheft.wire.scenario.motion_checks import motion_complaints
from coheft.wire.scenario.payload import Payload
from coheft.wire.scenario.payload_extent import load_place_complaints
from coheft.wire.scenario.payload_surface import from_text
from coheft.wire.scenario.plugin_checks import leaves, plugin_complaints
from coheft.wire.scenario.plugins import estimator_names
from coheft.wire.scenario.robot_sensors import in_words, other_sensors_complaints
from coheft.wire.scenario.rules import Complaint, check, exactly_one
from coheft.wire.scenario.schema import Scenario

_MOST_ROBOTS = 128
"""Of a team in which each robot estimates all poses: a fit takes half a second there."""
_LEAST_NOISE = 1e-3  # in units of the nominal noise
_LEVEL = 1e-9  # by which the vertical of a level frame may be off


def check_scenario(scenario: Scenario, origin: str) -> None:
    """Check all rules; raise ``ScenarioError``, which names ``origin``, if keys contradict each other."""
    check(
        scenario,
        origin,
        choice_complaints,
        _body_complaints,
        plugin_complaints,
        _range_complaints,
        slip_complaints,
        _sensor_complaints,
        noise_complaints,
        _carry_complaints,
        _encoder_complaints,
        motion_complaints,
        load_complaints,
        load_place_complaints,
        arm_complaints,
        _size_complaints,
    )


def choice_complaints(scenario: Scenario) -> Iterator[Complaint]:
    """Complain about numbers that are not finite, and keys that exclude or need each other, before files are read."""
    for place, value in leaves(msgspec.to_builtins(scenario)):
        if isinstance(value, float) and not math.isfinite(value):
            yield place, f"expected a finite number; found {value!r}"
    payload, robots = scenario.payload, scenario.robots
    yield from exactly_one(payload, ("boxes", "properties", "mjcf", "mesh"), "payload")
    yield from exactly_one(robots, ("grasps", "perimeter", "sites"), "robots")
    if payload.mesh is not None:
        yield from exactly_one(payload, ("mass", "density"), "payload")
    try:
        from_text(payload.surface)
    except ValueError as error:
        yield "payload.surface", f"{error}; leave it out: coheft fills it in"
    needs = {"body": "mjcf", "density": "mesh", "mass": "mesh", "scale": "mesh"}
    for key, needed in needs.items():
        if getattr(payload, key) != getattr(Payload(), key) and getattr(payload, needed) is None:
            yield f"payload.{key}", f"found it without 'payload.{needed}', which it describes"
    if robots.sites and payload.mjcf is None:
        yield (
            "robots.sites",
            f"found {', '.join(robots.sites)}, but only a model has sites: expected 'payload.mjcf', or "
            f"'robots.grasps' instead",
        )


def _body_complaints(scenario: Scenario) -> Iterator[Complaint]:
    payload, robots, motion = scenario.payload, scenario.robots, scenario.motion
    if payload.properties is not None and not payload.properties.can_exist():
        yield (
            "payload.properties.principal",
            f"found {list(payload.properties.principal)}, but no body has a moment of inertia larger than the sum of "
            f"the two others",
        )
    if robots.stiffness[1] == 0.0 and robots.damping[1] > 0.0:
        yield (
            "robots.damping",
            f"found {list(robots.damping)}, expected no damping of rotations where there is no stiffness: that is a "
            f"gimbal",
        )
    if robots.arms == "seven-joint" and robots.stiffness[1] == 0.0:
        yield (
            "robots.arms",
            f"found 'seven-joint' with 'robots.stiffness' = {list(robots.stiffness)}, expected stiffness in rotation: "
            f"their hands are no gimbals",
        )
    if scenario.robot_count < 2:
        yield "robots.grasps", "found 1 grasp, expected at least 2"
    if motion.own is not None and motion.via_points is not None:
        yield "motion", "found both 'via_points' and 'own', expected one of them at most"


def _range_complaints(scenario: Scenario) -> Iterator[Complaint]:
    """Complain about ranges that begin with the larger number."""
    ranges = [("motion.frequency", scenario.motion.frequency, "lower frequency")]
    if (via := scenario.motion.via_points) is not None:
        ranges += [(f"motion.via_points.{name}", getattr(via, name), "shorter one") for name in ("transit", "dwell")]
    for key, (low, high), first in ranges:
        if low > high:
            yield key, f"found {[low, high]}, expected the {first} first"


def noise_complaints(scenario: Scenario) -> Iterator[Complaint]:
    """Complain about sensors with so little noise that rounding and the time between samples would count for more."""
    sensors = scenario.sensors
    for name in SensorNoise.__struct_fields__:
        least = _LEAST_NOISE * getattr(SensorNoise(), name)
        if not least <= getattr(scenario.noise, name) < math.inf:
            yield (
                f"sensors.noise.{name}",
                f"found {getattr(sensors.noise, name):g}, times 'sensors.noise_scale' = {sensors.noise_scale:g}, "
                f"expected at least {least:g} in all: with less, rounding and the time between samples would count "
                f"for more than the noise",
            )
        for number, (robot, own) in enumerate(sensors.unequal().items()):
            if not least <= getattr(own.noise, name) < math.inf:
                found = f"found noise of the {name} of {robot} of {getattr(own.noise, name):g} with all factors"
                yield f"sensors.of[{number}]", f"{found}, expected at least {least:g}"


def _sensor_complaints(scenario: Scenario) -> Iterator[Complaint]:
    """Complain about sensors of single robots that contradict each other, or without which an estimator is wrong."""
    sensors = scenario.sensors
    yield from other_sensors_complaints(sensors.of, sensors.tolerance, scenario.robot_names)
    for number, each in enumerate(sensors.of):
        missing = tuple(sensor for sensor in each.without() if sensor in MOTION_SENSORS)
        key, found = f"sensors.of[{number}].missing", f"found {in_words(missing)} with " if missing else ""
        if missing and "fan2017" in estimator_names(scenario.estimator):
            yield key, f"{found}'estimator' = 'fan2017', expected 'efficient': 'fan2017' would use zeros instead"
        if "acceleration" in missing and scenario.carry is not None and scenario.carry.feedforward:
            yield (
                key,
                f"{found}'carry.feedforward' = true, expected false: a robot needs its accelerometer to know where "
                f"down is",
            )


def _carry_complaints(scenario: Scenario) -> Iterator[Complaint]:
    """Complain if the robots cannot carry the payload along a common path."""
    if scenario.carry is None:
        return
    if estimator_names(scenario.estimator)[0] != "efficient":
        yield (
            "carry",
            f"found with 'estimator' = '{scenario.estimator}', expected 'efficient': with others a robot knows its "
            f"neighbours' poses only, not those of the whole team",
        )
    if scenario.robots.stiffness[1] == 0.0:
        yield (
            "carry",
            f"found with 'robots.stiffness' = {list(scenario.robots.stiffness)}, expected stiffness in rotation: "
            f"gimbals cannot exert their share of a torque",
        )


def _encoder_complaints(scenario: Scenario) -> Iterator[Complaint]:
    """Complain if a recording of wrists with encoders would leave torques out, or have gravity point elsewhere.

    Gimbals transmit no torque, and home frames have to be level. What pushes with a torque needs stiffness in rotation
    (``_carry_complaints``), so do damping and arms of seven joints.
    """
    if scenario.sensors.encoders is None:
        return
    for number, each in enumerate(scenario.sensors.of):
        if each.missing:
            found = "found with 'sensors.encoders', expected none"
            yield f"sensors.of[{number}].missing", f"{found}: such recordings have poses and wrenches of all robots"
    if scenario.robots.stiffness[1] > 0.0:
        yield (
            "sensors.encoders",
            f"found with 'robots.stiffness' = {list(scenario.robots.stiffness)}, expected no stiffness in rotation: "
            f"such wrists are gimbals, and record no torque",
        )
    for name, grasp in zip(scenario.robot_names, scenario.robots.poses(), strict=True):
        off = float(np.linalg.norm(grasp.rotation[2] - [0.0, 0.0, 1.0]))
        if off >= _LEVEL:
            tilt = math.degrees(2.0 * math.asin(min(1.0, 0.5 * off)))
            yield (
                "sensors.encoders",
                f"found with a grasp of {name} that is tilted by {tilt:.3g}°, expected 'robots.grasps' turned about "
                f"the vertical only: home frames must be level, as recordings have gravity along their z axes",
            )


def _size_complaints(scenario: Scenario) -> Iterator[Complaint]:
    """Complain about messages that would be too large, and teams too large for an estimator that knows all of it."""
    names, size = estimator_names(scenario.estimator), largest_message(scenario)
    if size > LARGEST:
        is_fan2017 = "fan2017" in names
        other, found = ("fan2017.rounds", scenario.fan2017.rounds) if is_fan2017 else ("robots", scenario.robot_count)
        yield (
            "sensors.block",
            f"found {scenario.sensors.block}, and '{other}' = {found}: messages between neighbours would take up to "
            f"{size / 1e6:.1f} MB; expected at most {LARGEST / 1e6:.1f} MB: make one of the two smaller",
        )
    if "efficient" in names and scenario.robot_count > _MOST_ROBOTS:
        yield (
            "robots",
            f"found {scenario.robot_count} with 'estimator' = 'efficient', expected at most {_MOST_ROBOTS}: there each "
            f"robot finds the poses of all; memory grows as N², fits as N³ (docs/wide.md). With 'fan2017' it finds "
            f"those of its neighbours only",
        )
