"""The sensors of single robots that differ from those of the team."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from coheft.errors import ScenarioError
from coheft.estimation.measurement import Positive, SensorNoise
from coheft.estimation.tolerance import SensorTolerance
from coheft.wire.scenario.section import Section


class RobotSensors(NamedTuple):
    """Noise and tolerances of one robot's sensors, as all robots know them."""

    noise: SensorNoise
    tolerance: SensorTolerance


class OtherSensors(Section, frozen=True):
    """Sensors of one robot that differ from those of the others. What is left out is as for all robots.

    Attributes:
        robot: Name of the robot.
        noise: Standard deviations per sample, a whole table: keys that are left out have their defaults.
        noise_scale: Factor for its noise, beside ``sensors.noise_scale``.
        tolerance: Tolerances of its sensor errors, a whole data sheet: keys that are left out are exact.
    """

    robot: str
    noise: SensorNoise | None = None
    noise_scale: Positive = 1.0
    tolerance: SensorTolerance | None = None


def check_named(others: Sequence[OtherSensors], names: Sequence[str], place: str) -> None:
    """Check that sensors are given for robots of the team only, and once for each.

    Args:
        others: Sensors that differ.
        names: Names of the team's robots.
        place: What to begin an error with; the key of ``others`` follows.

    Raises:
        ScenarioError: They are not.
    """
    seen = list[str]()
    for number, each in enumerate(others):
        where = f"{place} 'sensors.of[{number}].robot': found {each.robot!r}"
        if each.robot not in names:
            raise ScenarioError(f"{where}, expected one of the robots {', '.join(names)}")
        if each.robot in seen:
            raise ScenarioError(f"{where} a second time, expected each robot once: put all its keys into one section")
        seen.append(each.robot)
