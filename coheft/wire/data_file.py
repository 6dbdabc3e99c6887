"""Recordings as files: ``.npz``, or a folder of CSV files, one per robot. ``docs/data-format.md`` describes both."""

from __future__ import annotations

import csv
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from coheft.errors import RecordingError
from coheft.estimation.batch.recording import GRAVITY, Recording, RobotRecord, Truth, check_recording
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.rigid_body import Inertia
from coheft.estimation.spatial import Array, Pose

TIME = "t"
COLUMNS = {
    "pose": ("x", "y", "z", "qx", "qy", "qz", "qw"),
    "twist": ("wx", "wy", "wz", "vx", "vy", "vz"),
    "dtwist": ("dwx", "dwy", "dwz", "dvx", "dvy", "dvz"),
    "acceleration": ("ax", "ay", "az"),
    "wrench": ("mx", "my", "mz", "fx", "fy", "fz"),
}
"""Channels of a robot and the names of their columns in CSV files."""
_SHARED = ("gravity", "holds", "noise")
_TRUTH = "truth"
_HOLDS_FILE = "holds"


def read_recording(path: Path) -> Recording:
    """Read and check a recording.

    Raises:
        RecordingError: It cannot be read, or not used; says what, and why.
    """
    try:
        recording = _read_folder(path) if path.is_dir() else _read_npz(path)
        check_recording(recording)
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error
    return recording


def write_recording(recording: Recording, path: Path) -> None:
    """Write a recording, to a folder of CSV files if the path has no suffix, else to an ``.npz`` file.

    CSV files hold samples and holds only.

    Raises:
        RecordingError: It cannot be written.
    """
    try:
        if path.suffix:
            with path.open("wb") as file:
                np.savez_compressed(file, allow_pickle=False, **_arrays(recording))
        else:
            _write_folder(recording, path)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written: {error.strerror}") from error


def _arrays(recording: Recording) -> dict[str, Array]:
    """All of a recording, by the names that the file gives it."""
    arrays = {"gravity": recording.gravity}
    for name, robot in recording.robots.items():
        arrays[f"{name}/{TIME}"] = robot.time
        for channel in COLUMNS:
            samples = getattr(robot, channel)
            if samples is not None:
                arrays[f"{name}/{channel}"] = _swapped(samples) if channel == "wrench" else samples
    if recording.noise is not None:
        arrays["noise"] = recording.noise.per_column()[::3]
    if recording.holds is not None:
        arrays["holds"] = np.array(recording.holds, dtype=np.float64).reshape(-1, 2)
    if recording.truth is not None:
        loads = recording.truth.loads
        arrays[f"{_TRUTH}/poses"] = np.array([pose.numbers() for pose in recording.truth.poses])
        arrays[f"{_TRUTH}/{TIME}"] = np.array([since for since, _ in loads])
        arrays[f"{_TRUTH}/mass"] = np.array([load.mass for _, load in loads])
        arrays[f"{_TRUTH}/com"] = np.array([load.com for _, load in loads])
        arrays[f"{_TRUTH}/inertia"] = np.array([load.tensor for _, load in loads])
    return arrays


def _read_npz(path: Path) -> Recording:
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {key: np.asarray(file[key], dtype=np.float64) for key in file.files}
    except (ValueError, zipfile.BadZipFile, EOFError) as error:
        raise RecordingError(f"not an .npz file of numbers: {error}") from error
    tables: dict[str, dict[str, Array]] = {}
    for key, array in arrays.items():
        name, slash, channel = key.rpartition("/")
        if slash and name != _TRUTH:
            tables.setdefault(name, {})[channel] = array
        elif not slash and key not in _SHARED:
            raise RecordingError(f"key '{key}' is unknown; allowed: {', '.join(_SHARED)}, ROBOT/CHANNEL")
    noise = None
    if "noise" in arrays:
        if arrays["noise"].shape != (5,) or not np.all(arrays["noise"] > 0.0):
            raise RecordingError("'noise': expected 5 positive numbers: gyro, velocity, acceleration, force, torque")
        noise = SensorNoise(*arrays["noise"].tolist())
    gravity = arrays.get("gravity", np.array(GRAVITY))
    if gravity.shape != (3,):
        raise RecordingError(f"'gravity': found shape {gravity.shape}, expected (3,)")
    return Recording(
        robots={name: _robot(name, tables[name]) for name in tables},
        gravity=gravity,
        noise=noise,
        holds=_holds(arrays["holds"]) if "holds" in arrays else None,
        truth=_truth({key.rpartition("/")[2]: array for key, array in arrays.items() if key.startswith(f"{_TRUTH}/")}),
    )


def _robot(name: str, table: Mapping[str, Array]) -> RobotRecord:
    unknown = set(table) - set(COLUMNS) - {TIME}
    if unknown:
        allowed = ", ".join([TIME, *COLUMNS])
        raise RecordingError(f"'{sorted(unknown)[0]}' of {name} is unknown; allowed: {allowed}")
    if TIME not in table:
        raise RecordingError(f"'{TIME}' of {name} is missing: the times of its samples")
    channels = {channel: array for channel, array in table.items() if channel != TIME}
    if "wrench" in channels and channels["wrench"].ndim == 2:
        channels["wrench"] = _swapped(channels["wrench"])
    return RobotRecord(table[TIME], **channels)


def _swapped(wrench: Array) -> Array:
    """Moment and force the other way round: files name the moment first."""
    return np.concatenate([wrench[:, 3:], wrench[:, :3]], axis=1)


def _holds(array: Array) -> tuple[tuple[float, float], ...]:
    if array.size == 0:
        return ()
    if array.ndim != 2 or array.shape[1] != 2:
        raise RecordingError(f"'holds': found shape {array.shape}, expected (k, 2): from when to when")
    return tuple((float(start), float(end)) for start, end in array)


def _truth(arrays: Mapping[str, Array]) -> Truth | None:
    if not arrays:
        return None
    try:
        loads = zip(arrays[TIME], arrays["mass"], arrays["com"], arrays["inertia"], strict=True)
        return Truth(
            poses=tuple(Pose.of_numbers(numbers) for numbers in arrays["poses"]),
            loads=tuple((float(since), Inertia(float(mass), com, tensor)) for since, mass, com, tensor in loads),
        )
    except (KeyError, ValueError) as error:
        raise RecordingError(f"'{_TRUTH}': incomplete: {error}") from error


def _read_folder(folder: Path) -> Recording:
    files = sorted(folder.glob("*.csv"))
    robots = {file.stem: _read_csv(file) for file in files if file.stem != _HOLDS_FILE}
    if not robots:
        raise RecordingError("no .csv files in this folder; expected one per robot")
    holds = None
    if (folder / f"{_HOLDS_FILE}.csv").exists():
        table = _table(folder / f"{_HOLDS_FILE}.csv")
        holds = _holds(np.column_stack([table.get("start", np.zeros(0)), table.get("end", np.zeros(0))]))
    return Recording(robots=robots, holds=holds)


def _read_csv(path: Path) -> RobotRecord:
    table = _table(path)
    known = {TIME, *(column for columns in COLUMNS.values() for column in columns)}
    unknown = [column for column in table if column not in known]
    if unknown:
        raise RecordingError(f"{path.name}: column '{unknown[0]}' is unknown; allowed: {', '.join(sorted(known))}")
    channels: dict[str, Array] = {TIME: table[TIME]} if TIME in table else {}
    for channel, columns in COLUMNS.items():
        missing = [column for column in columns if column not in table]
        if len(missing) < len(columns):
            if missing:
                raise RecordingError(
                    f"{path.name}: '{channel}' lacks column{'s' * (len(missing) > 1)} {', '.join(missing)}"
                )
            channels[channel] = np.column_stack([table[column] for column in columns])
    return _robot(path.stem, channels)


def _table(path: Path) -> dict[str, Array]:
    with path.open(newline="") as file:
        rows = list(csv.reader(file))
    if len(rows) < 2:
        raise RecordingError(f"{path.name}: expected a line with the names of columns, then numbers")
    header = [name.strip() for name in rows[0]]
    for number, row in enumerate(rows[1:], 2):
        if len(row) != len(header):
            raise RecordingError(f"{path.name}: line {number}: found {len(row)} values, expected {len(header)}")
    try:
        numbers = np.array(rows[1:], dtype=np.float64)
    except ValueError as error:
        raise RecordingError(f"{path.name}: {error}") from error
    return dict(zip(header, numbers.T, strict=True))


def _write_folder(recording: Recording, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, robot in recording.robots.items():
        header, columns = [TIME], [robot.time[:, None]]
        for channel, names in COLUMNS.items():
            samples = getattr(robot, channel)
            if samples is not None:
                header += names
                columns.append(_swapped(samples) if channel == "wrench" else samples)
        _write_csv(folder / f"{name}.csv", header, np.hstack(columns))
    if recording.holds is not None:
        _write_csv(folder / f"{_HOLDS_FILE}.csv", ["start", "end"], np.array(recording.holds).reshape(-1, 2))


def _write_csv(path: Path, header: list[str], rows: Array) -> None:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows([[repr(value) for value in row] for row in rows.tolist()])
