"""Teams whose robots differ, or whose grasps yield or slip: robots know what they lack, but not that a grasp slips.

One robot may lack a motion sensor, one may be noisier, one may have a compliant grasp, and one may slip. All of it is
set in the scenario, so that runs with real processes can have the same.
"""

import msgspec
import numpy as np

from coheft.app.faults.lasting import between, readable
from coheft.app.faults.schedule import FaultSchedule, Release
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.tolerance import SENSOR_NAMES
from coheft.wire.scenario.robot_sensors import Missing, OtherSensors
from coheft.wire.scenario.schema import Scenario, Slip
from coheft.wire.scenario.section import Vector

_SENSORS: tuple[Missing, ...] = ("gyro", "velocity", "acceleration")
_LACKING, _NOISY, _COMPLIANT, _SLIPPING = 0.6, 0.5, 0.3, 0.3
"""Shares of these teams in which a robot lacks a sensor, is noisier, has a compliant grasp, or slips."""
_NOISIER = (1.5, 5.0)
"""Range of the noise of a noisier robot, as a multiple of that of the others."""
_COMPLIANCE = (2e-6, 5e-5)
"""Range of compliances [m/N]."""
_DISPLACED, _TURNED = (0.01, 0.04), (0.5, 3.0)
"""Ranges of the length of a slip [m] and of its rotation [°]: both are noticed soon."""
_EARLIEST, _LATEST = 2.0, 6.0
"""Range of times of slips, later by ``delay`` [s]."""

_replace = msgspec.structs.replace


def _vector(lengths: tuple[float, float], rng: np.random.Generator) -> Vector:
    """Draw a vector with a length in this range."""
    size = readable(between(lengths, rng))
    direction: Array = rng.normal(size=3)
    x, y, z = (round(float(each), 4) for each in size * direction / np.linalg.norm(direction))
    return x, y, z


def with_unlike_robots(schedule: FaultSchedule, rng: np.random.Generator, delay: float) -> FaultSchedule:
    """Return a schedule with robots that differ, or with a slip, which is later by ``delay`` [s]."""
    scenario, names = schedule.scenario, schedule.scenario.robot_names
    robots = [names[k] for k in rng.permutation(len(names))]
    tolerance = _replace(scenario.sensors.tolerance, grasp_compliance=readable(between(_COMPLIANCE, rng)))
    differing = (
        (_LACKING, OtherSensors(robot=robots[0], missing=_SENSORS[rng.integers(len(_SENSORS))])),
        (_NOISY, OtherSensors(robot=robots[1], noise_scale=readable(between(_NOISIER, rng)))),
        (_COMPLIANT, OtherSensors(robot=robots[2], tolerance=tolerance)),
    )
    of = tuple(each for share, each in differing if rng.random() < share)
    scenario = _replace(scenario, sensors=_replace(scenario.sensors, of=of))
    releasing = {fault.robot for fault in schedule.faults if isinstance(fault, Release)}
    holding = [name for name in robots if name not in releasing]
    slip = Slip(
        at=round(delay + float(rng.uniform(_EARLIEST, _LATEST)), 3),
        robot=holding[0] if holding else robots[0],
        translation=_vector(_DISPLACED, rng),
        rotation_deg=_vector(_TURNED, rng),
    )
    if (rng.random() < _SLIPPING or not of) and holding:
        scenario = _replace(scenario, slips=(slip,), duration=max(scenario.duration, slip.at + scenario.block_duration))
    return _replace(schedule, scenario=scenario)


def unlike_kinds(scenario: Scenario) -> tuple[str, ...]:
    """Return in what robots differ in a scenario, and whether one slips, as kinds of lasting faults."""
    kinds = {kind for each in scenario.sensors.of for kind in differences(each)}
    return tuple(sorted(kinds | ({"slip"} if scenario.slips else set())))


def differences(sensors: OtherSensors) -> list[str]:
    """Return in what a robot with these sensors differs, as kinds of lasting faults."""
    kinds = [f"robot without {SENSOR_NAMES[sensor]}" for sensor in sensors.without()]
    kinds += ["noisier robot"] if sensors.noise_scale > 1.0 else []
    is_compliant = sensors.tolerance is not None and sensors.tolerance.grasp_compliance > 0.0
    return kinds + (["compliant grasp"] if is_compliant else [])
