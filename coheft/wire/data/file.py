"""Recordings as files: ``.npz``, or a folder of CSV files, one per robot. ``docs/data-format.md`` describes both."""

import os
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from coheft.errors import RecordingError, one_line, recording_errors
from coheft.estimation.batch.recording import GRAVITY, Recording, check_recording
from coheft.estimation.geometry.spatial import Array
from coheft.wire.data.checks import TIME, TRUTH, channels_of, gravity_of, holds_of, noise_of, robot_of, truth_of
from coheft.wire.data.folder import read_folder, write_folder
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
