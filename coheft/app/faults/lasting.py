"""Small lasting faults: sensor errors during the whole run, within known tolerances or not, and small load changes,
which are never announced.

Sensor errors are 0.3 to 3 times the sensor's noise at usual readings. They are set as the scenario's own errors and
tolerances, so that runs with real processes can have the same.
"""

import math
from collections.abc import Mapping

import msgspec
import numpy as np

from coheft.app.faults.readings import USUAL
from coheft.app.faults.schedule import FaultSchedule
from coheft.estimation.tolerance import INDUSTRIAL, SENSORS, SensorDrift, SensorTolerance
from coheft.wire.scenario.schema import LoadChange, Scenario, Sensors

SHAPES = ("offset", "scale", "mounting", "delay", "drift")
"""Kinds of lasting sensor errors."""
_SIZES = (0.3, 3.0)
"""Range of sizes, as multiples of the noise."""
_DELAY = 0.001
"""A delay of this has about the same effect as an offset of once the noise [s]."""
_CHANGES = (0.001, 0.05)
"""Range of small load changes, as shares of the payload's mass."""
_LEAKS = (2.0, 8.0)
"""Range of times in which such a share leaks out [s]."""
_MOST = 3
"""Largest number of errors in a schedule."""
_DECLARED, _LOAD, _LEAK = 0.5, 0.4, 0.5
"""Shares of schedules with known tolerances, of schedules with a small load change, and of leaks among these."""

_replace = msgspec.structs.replace


def with_lasting_errors(schedule: FaultSchedule, rng: np.random.Generator) -> FaultSchedule:
    """Return a schedule with additional lasting faults."""
    scenario = schedule.scenario
    if rng.random() < _LOAD:
        scenario = _replace(scenario, load_changes=(*scenario.load_changes, _small_change(scenario, rng)))
    is_declared = bool(rng.random() < _DECLARED)
    shapes = SHAPES if is_declared else SHAPES[:-1]  # a scenario's drift is always known to the robots
    keys: dict[str, float] = {}
    drift: dict[str, float] = {}
    for _ in range(rng.integers(1, _MOST + 1)):
        shape = shapes[rng.integers(len(shapes))]
        key, value = _error(scenario, shape, rng)
        (drift if shape == "drift" else keys)[key] = readable(value)
    return _replace(
        schedule, scenario=_replace(scenario, sensors=_with_errors(scenario.sensors, keys, drift, is_declared))
    )


def _error(scenario: Scenario, shape: str, rng: np.random.Generator) -> tuple[str, float]:
    """Draw a key of the tolerance, or of the drift, and its value."""
    size = between(_SIZES, rng)
    if shape == "delay":
        return ("clock", "wrench_delay")[rng.integers(2)], size * _DELAY
    with_shape = {"mounting": SENSORS[:3], "drift": tuple(SensorDrift.__struct_fields__)}.get(shape, SENSORS)
    sensor = with_shape[rng.integers(len(with_shape))]
    noise = size * float(getattr(scenario.noise, sensor))
    match shape:
        case "offset":
            return f"{sensor}_offset", noise
        case "scale":
            return f"{sensor}_scale", noise / USUAL[sensor]
        case "mounting":
            return f"{sensor}_mounting_deg", math.degrees(noise / USUAL[sensor])
    return sensor, noise * math.sqrt(60.0 / scenario.duration)  # reaches the size at the end


def _with_errors(sensors: Sensors, keys: Mapping[str, float], drift: Mapping[str, float], is_declared: bool) -> Sensors:
    before = sensors.tolerance
    errors = _replace(before, **{key: math.hypot(getattr(before, key), value) for key, value in keys.items()})
    if is_declared:
        return _replace(sensors, tolerance=errors, drift=_replace(sensors.drift, **drift))
    return _replace(sensors, errors=errors)


def _small_change(scenario: Scenario, rng: np.random.Generator) -> LoadChange:
    """Draw a change after all others, because loads are numbered in order."""
    width, depth = scenario.robots.perimeter.extent if scenario.robots.perimeter is not None else (0.5, 0.5)
    mass = readable(between(_CHANGES, rng) * scenario.payload.inertia().mass)
    leak = readable(mass / rng.uniform(*_LEAKS)) if rng.random() < _LEAK else 0.0
    latest = max([1.0, *(change.at for change in scenario.load_changes)])
    x, y = rng.uniform(-0.4, 0.4, size=2) * (width, depth)
    place = round(float(x), 3), round(float(y), 3), 0.1
    return LoadChange(at=round(latest + float(rng.uniform(0.5, 6.0)), 3), mass=mass, position=place, leak=leak)


def between(ends: tuple[float, float], rng: np.random.Generator) -> float:
    """Draw a number whose logarithm is uniform."""
    low, high = ends
    return float(low * (high / low) ** rng.random())


def readable(value: float) -> float:
    """Round to three digits."""
    return float(f"{value:.3g}")


def is_undeclared(scenario: Scenario) -> bool:
    """Whether sensor errors exceed the tolerances that robots know."""
    return isinstance(scenario.sensors.errors, SensorTolerance)


def lasting_kinds(scenario: Scenario) -> tuple[str, ...]:
    """Return the kinds of lasting faults in a scenario, apart from those with which teams are drawn anyway."""
    tolerance, errors = scenario.sensors.tolerance, scenario.sensor_errors
    usual, word = (tolerance, "undeclared") if is_undeclared(scenario) else (_usual(tolerance), "declared")
    kinds = {
        f"{word} {_shape(key)}"
        for key in SensorTolerance.__struct_fields__
        if getattr(errors, key) != getattr(usual, key)
    }
    kinds |= {f"{word} drift"} if scenario.sensors.drift.is_any else set()
    small = _CHANGES[1] * scenario.payload.inertia().mass
    for change in scenario.load_changes:
        if change.leak > 0.0:
            kinds.add("slow leak")
        elif change.mass is not None and change.mass <= small:
            kinds.add("small change of the load")
    return tuple(sorted(kinds))


def _usual(tolerance: SensorTolerance) -> SensorTolerance:
    """Return the tolerance of a good industrial arm if no value is smaller; otherwise one without errors."""
    fields = SensorTolerance.__struct_fields__
    is_industrial = all(getattr(tolerance, key) >= getattr(INDUSTRIAL, key) for key in fields)
    return INDUSTRIAL if is_industrial else SensorTolerance()


def _shape(key: str) -> str:
    return "delay" if key in ("clock", "wrench_delay") else key.removesuffix("_deg").rpartition("_")[2]
