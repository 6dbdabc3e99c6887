"""Sentences about the sensor errors that robots have estimated."""

from collections.abc import Mapping

from coheft.app.results.judge import RobotReport
from coheft.app.terminal.digits import significant
from coheft.estimation.tolerance import SENSOR_NAMES
from coheft.wire.messages.structs import SensorErrorEstimate

_NOTABLE = 2.0
"""Errors of at least this number of prior standard deviations are reported, if their std is less than half the
prior."""
_OFFSET_UNITS = {"gyro": "rad/s", "velocity": "m/s", "acceleration": "m/s²", "force": "N", "torque": "N·m"}


def sensor_sentences(robots: Mapping[str, RobotReport]) -> list[str]:
    """Return one sentence for each error that is large compared with its tolerance, the largest first."""
    found = [
        (abs(error.value) / error.told, name, error)
        for name, robot in robots.items()
        for error in robot.sensor_errors
        if abs(error.value) > _NOTABLE * error.told and 2.0 * error.std < error.told
    ]
    return [f"{name}'s {_in_words(error)}." for _, name, error in sorted(found, key=lambda each: -each[0])]


def _in_words(error: SensorErrorEstimate) -> str:
    if error.key == "clock":
        return f"clock is {_amount(error, 'ms', 1e3)} {_late(error)}"
    if error.key == "grasp_compliance":
        return f"grasp yields by {_amount(error, 'mm/N', 1e3)}"
    if error.key == "wrench_delay":
        return f"force and torque sensor is {_amount(error, 'ms', 1e3)} {_late(error)}"
    sensor, _, what = error.key.partition("_")
    name, along = SENSOR_NAMES[sensor], f" along {error.axis}" if error.axis else ""
    much = "much" if error.value > 0.0 else "little"
    match what:
        case "offset":
            return f"{name} reads {_amount(error, _OFFSET_UNITS[sensor])} too {much}{along}"
        case "mounting_deg":
            return f"{name} is turned by {_amount(error, '°', signed=True)} about {error.axis}"
        case "cross_talk":
            share = _amount(error, "%", 100.0, signed=True)
            return f"{name} reads {share} of {' and '.join(error.axis)} of each other"
        case "place":
            return f"{name} is {_amount(error, 'mm', 1e3, signed=True)} away{along}"
        case _:
            return f"{name} reads {_amount(error, '%', 100.0)} too {much}{along}"


def _late(error: SensorErrorEstimate) -> str:
    return "late" if error.value > 0.0 else "early"


def _amount(error: SensorErrorEstimate, unit: str, scale: float = 1.0, *, signed: bool = False) -> str:
    value = scale * (error.value if signed else abs(error.value))
    space = "" if unit == "°" else " "
    std, tolerance = significant(scale * error.std, 1), significant(scale * error.told, 3)
    return f"{significant(value, 3)} ± {std}{space}{unit} (tolerance {tolerance}{space}{unit})"
