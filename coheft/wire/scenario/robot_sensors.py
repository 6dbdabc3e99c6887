"""The sensors of single robots that differ from those of the team."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple

from coheft.estimation.measurement import Positive, SensorNoise
from coheft.estimation.tolerance import SensorTolerance
from coheft.wire.scenario.section import Section


class RobotSensors(NamedTuple):
    """One robot's sensors, as all robots know them.

    Attributes:
        noise: Their noise.
        tolerance: Their tolerances.
        missing: Which of ``force`` and ``torque`` it does not measure, so that it reads zero there.
    """

    noise: SensorNoise
    tolerance: SensorTolerance
    missing: tuple[str, ...] = ()


class OtherSensors(Section, frozen=True):
    """Sensors of one robot that differ from those of the others. What is left out is as for all robots.

    Attributes:
        robot: Name of the robot.
        noise: Standard deviations per sample, a whole table: keys that are left out have their defaults.
        noise_scale: Factor for its noise, beside ``sensors.noise_scale``.
        tolerance: Tolerances of its sensor errors, a whole data sheet: keys that are left out are exact.
        missing: What its wrist does not measure: the ``torque``, or all of the ``wrench``. What needs the total of what
            is missing is then not known, see docs/sensors.md. By default nothing.
    """

    robot: str
    noise: SensorNoise | None = None
    noise_scale: Positive = 1.0
    tolerance: SensorTolerance | None = None
    missing: Literal["torque", "wrench"] | None = None

    def on(self, noise: SensorNoise, scale: float, tolerance: SensorTolerance) -> RobotSensors:
        """Return all of this robot's sensors, given noise, its factor, and tolerances of all robots."""
        return RobotSensors(
            (self.noise or noise).scaled(scale * self.noise_scale),
            tolerance if self.tolerance is None else self.tolerance,
            {None: (), "torque": ("torque",), "wrench": ("force", "torque")}[self.missing],
        )


def named_complaints(others: Sequence[OtherSensors], names: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Complain about sensors of robots that are not in the team, or are there twice, as a rule of a scenario does.

    Args:
        others: Sensors that differ.
        names: Names of the team's robots.
    """
    for number, each in enumerate(others):
        key, found = f"sensors.of[{number}].robot", f"found {each.robot!r}"
        if each.robot not in names:
            yield key, f"{found}, expected one of the robots {', '.join(names)}"
        if any(each.robot == other.robot for other in others[:number]):
            yield key, f"{found} a second time, expected each robot once: put all its keys into one section"
