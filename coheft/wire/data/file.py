"""Recordings as files: ``.npz``, or a folder of CSV files, one per robot. ``docs/data-format.md`` describes both.

Holds that are recorded separately are a line, or an interval of samples, for each orientation of the load.
"""

import os
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Callable, Mapping
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from coheft.errors import RecordingError, one_line, recording_errors
from coheft.estimation.batch.holds import means_in_holds
from coheft.estimation.batch.recording import GRAVITY, Recording, check_recording, check_samples
from coheft.estimation.batch.signals import turns
from coheft.estimation.geometry.spatial import Array
from coheft.wire.data.checks import (
    TIME,
    TRUTH,
    channels_of,
    gravity_of,
    holds_of,
    noise_of,
    record_at,
    robot_of,
    truth_of,
)
from coheft.wire.data.folder import read_channels, read_folder, write_folder
from coheft.wire.data.replace import replace_files
from coheft.wire.data.times import at_common_times, holds_in_seconds, span_of

_SHARED = ("gravity", "holds", "noise")
_BEGINNINGS = (b"PK\x03\x04", b"PK\x05\x06", b"\x93NUMPY")
"""First bytes of zip archives such as ``.npz`` files, full and empty, and of single arrays; other files are refused."""
_EXPECTED = (
    "expected what 'coheft run --save-data' or np.savez writes, a folder of CSV files, an MCAP file or a bag of ROS"
)
_DAMAGED = (
    *(ValueError, TypeError, KeyError, EOFError, RuntimeError, MemoryError, SyntaxError),
    *(zipfile.BadZipFile, zlib.error, struct.error, tokenize.TokenError),
)
"""Exceptions of numpy and zipfile for files that are incomplete, damaged, encrypted, or something else."""
_GAP = 10.0
"""Number of missing samples that separate two holds."""
_TURN = np.radians(2.0)
"""Lines with a larger rotation between them are separate holds [rad]: no robot moves as fast between samples."""
_NEEDED = ("pose", "wrench")


def read_recording(path: Path) -> Recording:
    """Read and check a recording."""
    with recording_errors(path):
        return read_folder(path) if path.is_dir() else recording_of(load_arrays(path))


def write_recording(recording: Recording, path: Path) -> None:
    """Write a recording, to an ``.npz`` file, or to a folder of CSV files if the path has no suffix.

    CSV files contain samples and holds only. Existing files are replaced only when the new recording is complete.

    Raises:
        RecordingError: It cannot be written, or the folder contains CSV files that do not belong to a recording.
    """
    if path.suffix not in ("", ".npz"):
        raise RecordingError(f"{path}: expected a file that ends with .npz, or a folder, without suffix")
    with recording_errors(path, "cannot be written"):
        if path.suffix:
            arrays: dict[str, Any] = dict(_arrays(recording))
            target = Path(os.path.realpath(path))  # keeps a symbolic link
            replace_files({target: lambda file: np.savez_compressed(file, **arrays)})
        else:
            write_folder(recording, path)


def _arrays(recording: Recording) -> dict[str, Array]:
    """Return all arrays of a recording, by their names in files."""
    arrays = {"gravity": recording.gravity}
    for name, robot in recording.robots.items():
        arrays[f"{name}/{TIME}"] = robot.time
        arrays |= {f"{name}/{channel}": samples for channel, samples in channels_of(robot).items()}
    if recording.noise is not None:
        arrays["noise"] = recording.noise.per_column()[::3]
    if recording.holds is not None:
        arrays["holds"] = np.array(recording.holds, dtype=np.float64).reshape(-1, 2)
    if recording.truth is not None:
        loads = recording.truth.loads
        arrays[f"{TRUTH}/poses"] = np.array([pose.numbers() for pose in recording.truth.poses])
        arrays[f"{TRUTH}/{TIME}"] = np.array([since for since, _ in loads])
        arrays[f"{TRUTH}/mass"] = np.array([load.mass for _, load in loads])
        arrays[f"{TRUTH}/com"] = np.array([load.com for _, load in loads])
        arrays[f"{TRUTH}/inertia"] = np.array([load.tensor for _, load in loads])
    return arrays


def _gravity(shared: Mapping[str, Array]) -> Array:
    return gravity_of(shared["gravity"]) if "gravity" in shared else np.array(GRAVITY)


def _tables(arrays: Mapping[str, npt.ArrayLike]) -> tuple[dict[str, dict[str, Array]], dict[str, Array]]:
    """Return the arrays of robots and of the truth, by name and channel, and those of the whole recording."""
    tables: dict[str, dict[str, Array]] = {}
    shared: dict[str, Array] = {}
    for key, values in arrays.items():
        name, slash, channel = key.rpartition("/")
        if slash:
            tables.setdefault(name, {})[channel] = _numbers(key, values, "not a recording")
        elif key in _SHARED:
            shared[key] = _numbers(key, values, "not a recording")
        else:
            raise RecordingError(f"key '{one_line(key)}' is unknown; allowed: {', '.join(_SHARED)}, ROBOT/CHANNEL")
    return tables, shared


def recording_of(arrays: Mapping[str, npt.ArrayLike]) -> Recording:
    """Make and check a recording from arrays, by their names in an ``.npz`` file."""
    tables, shared = _tables(arrays)
    truth = tables.pop(TRUTH, {})
    if not tables:
        raise RecordingError(f"no robots in it; expected arrays ROBOT/{TIME} and ROBOT/CHANNEL of each")
    robots = at_common_times({name: robot_of(name, table) for name, table in tables.items()})
    recording = Recording(
        robots=robots,
        gravity=_gravity(shared),
        noise=noise_of(shared["noise"]) if "noise" in shared else None,
        holds=holds_in_seconds("'holds'", holds_of(shared["holds"]), span_of(robots)) if "holds" in shared else None,
        truth=truth_of(truth, len(tables)),
    )
    check_recording(recording)
    return recording


def channels_in(arrays: Mapping[str, npt.ArrayLike]) -> tuple[dict[str, dict[str, Array]], Array]:
    """Return each robot's channels in arrays as of an ``.npz`` file, unchanged, possibly without times, and gravity."""
    tables, shared = _tables(arrays)
    tables.pop(TRUTH, None)
    return tables, _gravity(shared)


def load_arrays(path: Path) -> dict[str, Array]:
    """Return all arrays of an ``.npz`` file, by their keys."""
    try:
        with path.open("rb") as file:  # numpy itself does not close damaged files
            if not file.read(max(map(len, _BEGINNINGS))).startswith(_BEGINNINGS):
                raise RecordingError(f"not an .npz file; {_EXPECTED}")
            file.seek(0)
            loaded = np.load(file, allow_pickle=False)
            if not isinstance(loaded, np.lib.npyio.NpzFile):
                raise RecordingError(
                    f"found a single array of shape {loaded.shape}, expected an .npz file with one per robot and "
                    f"channel, as np.savez writes"
                )
            keys = loaded.files
            arrays = {key: np.asarray(loaded[key]) for key in keys}
    except _DAMAGED as error:
        raise RecordingError(f"not an .npz file of numbers: {one_line(str(error))}; {_EXPECTED}") from error
    if len(arrays) < len(keys):
        raise RecordingError("an array is there more than once, expected each key once: write the file again")
    return {key: _numbers(key, array, "not an .npz file of numbers") for key, array in arrays.items()}


_ADVICE = dict.fromkeys("mM", ": convert it with .astype('datetime64[ns]').astype('int64')") | {
    "U": ": convert it with .astype(float)"
}
"""What to do with other types, by numpy's kinds."""


def _numbers(key: str, values: npt.ArrayLike, what: str) -> Array:
    """Convert values to an array of real numbers; ``what`` begins the error."""
    try:
        array = np.asarray(values)
    except ValueError as error:  # rows of different lengths
        raise RecordingError(f"'{one_line(key)}': expected an array of numbers: {one_line(str(error))}") from error
    if array.dtype.kind not in "biuf":
        advice = _ADVICE.get(array.dtype.kind, "")
        raise RecordingError(f"{what}: '{one_line(key)}' holds values of type {array.dtype}, expected numbers{advice}")
    return array.astype(np.float64)


def read_statics(path: Path) -> Recording:
    """Read means in holds, from an ``.npz`` file or a folder of CSV files: poses and wrenches of each robot.

    Without times, or if the load rotates from line to line, each line is a hold. Otherwise a hold lasts until there is
    a gap; if there are no gaps, as long as forces do not change.
    """
    if not path.is_dir():
        return statics_of(load_arrays(path))
    return _statics(read_channels(path), np.array(GRAVITY), partial(read_recording, path))


def statics_of(arrays: Mapping[str, npt.ArrayLike]) -> Recording:
    """Make holds from arrays, by their names in an ``.npz`` file; rules and errors as of ``read_statics``."""
    return _statics(*channels_in(arrays), partial(recording_of, arrays))


def _statics(tables: Mapping[str, Mapping[str, Array]], gravity: Array, whole: Callable[[], Recording]) -> Recording:
    """Holds in robots' channels; ``whole`` is called if these are a recording of which the forces tell the holds."""
    if not tables:
        raise RecordingError("no robots; expected poses and wrenches of each")
    for name, table in tables.items():
        missing = [channel for channel in _NEEDED if channel not in table]
        if missing:
            found = one_line(", ".join(table))
            raise RecordingError(
                f"'{missing[0]}' of {name} is missing; found {found}; expected pose and wrench of holds"
            )
    lengths = {name: len(np.atleast_1d(table["pose"])) for name, table in tables.items()}
    if len(set(lengths.values())) > 1:
        counts = ", ".join(f"{count} of {name}" for name, count in lengths.items())
        raise RecordingError(f"found different numbers of lines: {counts}; expected one for each hold of every robot")
    first = next(iter(tables))
    time = np.arange(lengths[first], dtype=np.float64)
    robots = {name: record_at(time, name, table) for name, table in tables.items()}
    for name, robot in robots.items():
        check_samples(name, robot)
    spans = _spans(tables[first].get(TIME), tables[first]["pose"], first)
    return means_in_holds(whole() if spans is None else Recording(robots, gravity=gravity), spans)


def _spans(time: Array | None, pose: Array, name: str) -> list[tuple[int, int]] | None:
    """Return first and one past the last line of each hold; None if it was recorded without gaps.

    Times (n,) of the lines have any unit; None if not recorded. Poses have the shape (n, 7).
    """
    count = len(pose)
    if time is not None and time.shape != (count,):
        raise RecordingError(f"'{TIME}' of {name}: found shape {time.shape}, expected {(count,)}, or none")
    if time is None or count < 2 or np.median(turns(pose[:-1], pose[1:])) > _TURN:
        return [(k, k + 1) for k in range(count)]
    steps = np.diff(time)
    if not (steps > 0.0).all():
        raise RecordingError(f"'{TIME}' of {name}: expected times that grow, or none")
    gaps = np.flatnonzero(steps > _GAP * np.median(steps)) + 1
    if not len(gaps):
        return None
    return list(pairwise([0, *gaps.tolist(), count]))
