"""The sensors of single robots that differ from those of the team."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from coheft.estimation.batch.recording import RobotRecord
from coheft.estimation.measurement import ACCELERATION, TWIST, WRENCH, Positive, SensorNoise
from coheft.estimation.tolerance import SENSOR_NAMES, SENSORS, SensorTolerance
from coheft.wire.scenario.section import Section

Missing = Literal["gyro", "velocity", "acceleration", "torque", "wrench"]
_CHANNELS = {"twist": TWIST, "acceleration": ACCELERATION, "wrench": WRENCH}
"""Channels of a recording, and their columns in a sample."""
_TURNED_BY_GYRO = ("velocity_place", "acceleration_place", "grasp_compliance")
"""Errors that a robot corrects by what its own gyro reads."""
TEAM_NEEDS = ("gyro", "acceleration")
"""Sensors of which a team needs one: only these show how the load turns, and how it accelerates."""


class RobotSensors(NamedTuple):
    """One robot's sensors, as all robots know them.

    Attributes:
        tolerance: Their tolerances; those of sensors that are missing are 0.
        missing: Which of ``SENSORS`` it does not have, so that it reads zero there.
    """

    noise: SensorNoise
    tolerance: SensorTolerance
    missing: tuple[str, ...] = ()

    def is_missing(self) -> npt.NDArray[np.bool_]:
        """Whether the robot does not measure each column of a sample, shape (15,)."""
        return np.repeat([sensor in self.missing for sensor in SENSORS], 3)

    def recorded(self, record: RobotRecord) -> RobotRecord:
        """Return a record without the channels that the robot does not measure, or only in part."""
        missing = self.is_missing()
        without: dict[str, Any] = {name: None for name, columns in _CHANNELS.items() if missing[columns].any()}
        return replace(record, **without)


class OtherSensors(Section, frozen=True):
    """Sensors of one robot that differ from those of the others. What is left out is as for all robots.

    Attributes:
        robot: Name of the robot.
        noise: Standard deviations per sample, a whole table: keys that are left out have their defaults.
        noise_scale: Factor for its noise, beside ``sensors.noise_scale``.
        tolerance: One standard deviation of each of its sensor errors, a whole data sheet: keys that are left out are
            exact.
        missing: What it does not measure, one of these or a list of several; ``wrench`` is force and torque. By default
            nothing. What is then not known: see docs/sensors.md.
    """

    robot: str
    noise: SensorNoise | None = None
    noise_scale: Positive = 1.0
    tolerance: SensorTolerance | None = None
    missing: Missing | tuple[Missing, ...] | None = None

    def on(self, noise: SensorNoise, scale: float, tolerance: SensorTolerance) -> RobotSensors:
        """Return all of this robot's sensors, given noise, its factor, and tolerances of all robots."""
        told, missing = tolerance if self.tolerance is None else self.tolerance, self.without()
        exact = [key for key in told.__struct_fields__ if key.split("_")[0] in missing]
        return RobotSensors(
            (self.noise or noise).scaled(scale * self.noise_scale),
            msgspec.structs.replace(told, **dict.fromkeys(exact, 0.0)),
            missing,
        )

    def without(self) -> tuple[str, ...]:
        """Return which of ``SENSORS`` it does not have."""
        told = (self.missing,) if isinstance(self.missing, str) else self.missing or ()
        named = {"force", "torque", *told} if "wrench" in told else set(told)
        return tuple(sensor for sensor in SENSORS if sensor in named)


def other_sensors_complaints(
    others: Sequence[OtherSensors], tolerance: SensorTolerance, names: Sequence[str]
) -> Iterator[tuple[str, str]]:
    """Complain about sensors of single robots that contradict each other, as a rule of a scenario does.

    ``tolerance`` is that of all robots that give none of their own.
    """
    for number, each in enumerate(others):
        key, found = f"sensors.of[{number}].robot", f"found {each.robot!r}"
        if each.robot not in names:
            yield key, f"{found}, expected one of the robots {', '.join(names)}"
        if any(each.robot == other.robot for other in others[:number]):
            yield key, f"{found} a second time, expected each robot once: put all its keys into one section"
        missing, told = each.without(), tolerance if each.tolerance is None else each.tolerance
        key = f"sensors.of[{number}].missing"
        if {"velocity", "acceleration"} <= set(missing):
            yield (
                key,
                f"found {in_words(missing)}, expected a velocity sensor or an accelerometer at least: a gyro does not "
                f"show where a robot holds the load",
            )
        displaced = [name for name in _TURNED_BY_GYRO if getattr(told, name) > 0.0]
        if "gyro" in missing and displaced:
            yield (
                key,
                f"found gyro with {displaced[0]} = {getattr(told, displaced[0]):g}, expected 0: what a displaced "
                f"sensor reads is corrected by the robot's own gyro",
            )
        if "force" in missing and told.grasp_compliance > 0.0:
            yield (
                key,
                f"found {in_words(missing)} with grasp_compliance = {told.grasp_compliance:g}, expected 0: how far a "
                f"grasp yields is computed from the robot's own force",
            )
    for sensor in TEAM_NEEDS:
        if sum(sensor in each.without() for each in others) >= len(names):
            yield (
                "sensors.of",
                f"found the {SENSOR_NAMES[sensor]} missing of all robots, expected one in the team at least",
            )


def in_words(sensors: Sequence[str]) -> str:
    """Return the names of sensors, in words."""
    *first, last = (SENSOR_NAMES[sensor] for sensor in sensors)
    return f"{', '.join(first)} and {last}" if first else last
