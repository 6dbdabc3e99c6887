"""Names of the parts of a recording in files, and checks of their contents. ``docs/data-format.md`` lists them."""

from collections.abc import Mapping

import numpy as np

from coheft.errors import RecordingError, one_line
from coheft.estimation.batch.recording import CHANNELS, RobotRecord, Truth
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.wire.data.times import samples_in_seconds

TIME = "t"
COLUMNS = {**CHANNELS, "wrench": ("mx", "my", "mz", "fx", "fy", "fz")}
"""Channels of a robot and the names of their columns in CSV files, in which the torque comes first."""
TRUTH = "truth"
_LEAST_GRAVITY, _MOST_GRAVITY = 1.5, 30.0
"""Range of gravity on planets and moons [m/s²]."""


def channels_of(robot: RobotRecord) -> dict[str, Array]:
    """Return a robot's recorded channels: arrays (n, width), in the order of ``COLUMNS``, without times."""
    found = robot.channels
    return found if robot.wrench is None else {**found, "wrench": _swapped(robot.wrench)}


def robot_of(name: str, table: Mapping[str, Array]) -> RobotRecord:
    """Make a robot's record from channels and ``t`` (n,). The shapes of channels are not checked."""
    if TIME not in table:
        raise RecordingError(
            f"'{TIME}' of {name} is missing: the times of its samples; if each line is a hold: --method static"
        )
    _check(f"'{TIME}' of {name}", table[TIME], (table[TIME].size,))
    return record_at(samples_in_seconds(name, table[TIME]), name, table)


def record_at(time: Array, name: str, table: Mapping[str, Array]) -> RobotRecord:
    """Make a robot's record from channels, at other times (n,) [s] than those in ``table``, if any."""
    unknown = set(table) - set(COLUMNS) - {TIME}
    if unknown:
        allowed = ", ".join([TIME, *COLUMNS])
        raise RecordingError(f"'{one_line(min(unknown))}' of {name} is unknown; allowed: {allowed}")
    channels = {channel: array for channel, array in table.items() if channel != TIME}
    if "wrench" in channels and channels["wrench"].ndim == 2:
        channels["wrench"] = _swapped(channels["wrench"])
    return RobotRecord(time, **channels)


def gravity_of(array: Array) -> Array:
    """Check gravity, shape (3,) [m/s²]; raise ``RecordingError`` if it is invalid."""
    _check("'gravity'", array, (3,))
    size = float(np.linalg.norm(array))
    if array.any() and not _LEAST_GRAVITY < size < _MOST_GRAVITY:
        raise RecordingError(f"'gravity' is {size:g} m/s², expected about 9.81 m/s², as in [0, 0, -9.81]")
    return array


def noise_of(array: Array) -> SensorNoise:
    """Make the noise from its standard deviations, shape (5,); raise ``RecordingError`` if they are invalid."""
    if array.shape != (5,) or not np.all(np.isfinite(array) & (array > 0.0)):
        raise RecordingError(
            f"'noise': expected 5 positive numbers: gyro, velocity, acceleration, force, torque; "
            f"found {one_line(str(array.tolist()))}"
        )
    return SensorNoise(*array.tolist())


def holds_of(array: Array) -> tuple[tuple[float, float], ...]:
    """Check intervals in which the load was still, an array (k, 2) in its unit; an empty one may have any shape."""
    if array.size == 0:
        return ()
    if array.ndim != 2 or array.shape[1] != 2:
        raise RecordingError(f"'holds': found shape {array.shape}, expected (k, 2): from when to when")
    _check("'holds'", array, array.shape)
    holds = tuple((float(start), float(end)) for start, end in array)
    for start, end in holds:
        if start >= end:
            raise RecordingError(f"'holds': found one from {start:g} to {end:g}, expected its start before its end")
    return holds


def truth_of(arrays: Mapping[str, Array], robots: int) -> Truth | None:
    """Make the truth from ``poses`` (N, 12), ``t`` and ``mass`` (k,), ``com`` (k, 3), ``inertia`` (k, 3, 3).

    Without arrays there is no truth.
    """
    if not arrays:
        return None
    count = arrays[TIME].size if TIME in arrays else 0
    shapes = {
        "poses": (robots, Pose.SIZE),
        TIME: (count,),
        "mass": (count,),
        "com": (count, 3),
        "inertia": (count, 3, 3),
    }
    missing = [key for key in shapes if key not in arrays]
    if missing:
        raise RecordingError(f"'{TRUTH}': incomplete: '{missing[0]}' is missing; expected {', '.join(shapes)}")
    unknown = set(arrays) - set(shapes)
    if unknown:
        raise RecordingError(f"'{TRUTH}/{one_line(min(unknown))}' is unknown; allowed: {', '.join(shapes)}")
    for key, shape in shapes.items():
        _check(f"'{TRUTH}/{key}'", arrays[key], shape)
    if not np.all(np.diff(arrays[TIME]) > 0.0):
        raise RecordingError(f"'{TRUTH}/{TIME}': expected growing times, from which on something was held")
    loads = zip(arrays[TIME], arrays["mass"], arrays["com"], arrays["inertia"], strict=True)
    return Truth(
        poses=tuple(Pose.of_numbers(numbers) for numbers in arrays["poses"]),
        loads=tuple((float(since), Inertia(float(mass), com, tensor)) for since, mass, com, tensor in loads),
    )


def _check(what: str, array: Array, shape: tuple[int, ...]) -> None:
    """Refuse an array of another shape, or with numbers that are not finite."""
    if array.shape != shape:
        raise RecordingError(f"{what}: found shape {array.shape}, expected {shape}")
    if not np.isfinite(array).all():
        found = array[~np.isfinite(array)][0]
        raise RecordingError(f"{what}: found {found}, expected finite numbers")


def _swapped(wrench: Array) -> Array:
    """Swap torque and force: files have the torque first."""
    return np.concatenate([wrench[:, 3:], wrench[:, :3]], axis=1)
