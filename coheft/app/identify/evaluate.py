"""Identification of a load from any recording, in files or in arrays, for the command and the Python interface."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from importlib import import_module
from math import inf
from pathlib import Path

import numpy.typing as npt

from coheft.app.identify.choices import Bounds, Options
from coheft.app.identify.methods import identify, part_of
from coheft.errors import RecordingError, UsageError, recording_errors
from coheft.estimation.batch.holds import means_in_holds
from coheft.estimation.batch.identification import Identification
from coheft.estimation.batch.recording import Recording
from coheft.wire.data.file import read_recording, recording_of
from coheft.wire.data.statics import read_statics, statics_of

ARRAYS = "arrays"
"""Name of a recording without a file, in errors and reports."""
_MOST = {"misalignment_deg": 90.0, "force_offset": inf}
"""Limits of bounds [degrees, N]; those of scales are less than 1."""
_OF_TOPICS = (".mcap", ".bag", ".db3")
_TABLES = ".csv"
_METADATA = "metadata.yaml"
"""File in each bag of ROS 2, which is a folder."""


def evaluate(recording: Path | Mapping[str, npt.ArrayLike], options: Options) -> tuple[Recording, Identification]:
    """Identify the load of a recording.

    Returns:
        The part of the recording that was used, and the identification.

    Raises:
        RecordingError: It cannot be read, or cannot be a recording of one load; the message says why.
        UsageError: Options contradict each other.
    """
    holds, is_static = options.holds, options.method == "static"
    if options.bounds is not None and not options.calibrate:
        raise UsageError("bounds are of errors that --calibrate estimates: add it, or leave them out")
    for name, bound in asdict(options.bounds or Bounds()).items():
        most = _MOST.get(name, 1.0)
        if not 0.0 <= bound < most:
            raise UsageError(f"--{name.replace('_', '-')} {bound:g}: expected a bound from 0 to less than {most:g}")
    if is_static and (holds is not None or options.from_ is not None or options.to is not None):
        raise UsageError("--method static takes all holds of RECORDING: leave --holds, --from and --to out")
    statics: Recording | None = None
    if isinstance(recording, Mapping):
        if options.topics:
            raise UsageError("--topics chooses among those of an MCAP file or a bag of ROS, but arrays have none")
        with recording_errors(ARRAYS):
            statics = statics_of(recording) if is_static else None
            recorded = statics or recording_of(recording)
    elif is_static and not options.topics:
        recorded = statics = read_holds(recording)
    else:
        recorded = read_any(recording, options.topics)
    if holds is not None:
        statics = read_holds(holds, recorded.names)
    with recording_errors(ARRAYS if isinstance(recording, Mapping) else recording):
        recorded = part_of(recorded, options.from_, options.to)
        return recorded, identify(recorded, options, statics)


def read_any(path: Path, topics: Sequence[str] = ()) -> Recording:
    """Read a recording: ``.npz``, a folder of CSV files, an MCAP file, or a bag of ROS.

    ``topics`` names topics of each robot, as ``ROBOT=TOPIC``; without it, the topics' names tell.

    Raises:
        RecordingError: It cannot be read or used; the message says why.
        UsageError: Topics are given for a file that has none.
        MissingPackageError: The packages for reading topics are not installed.
    """
    if _is_of_topics(path):
        import_module("coheft.app.recording")  # raises MissingPackageError
        from coheft.app.identify.topics import read_topics

        return read_topics(path, topics)
    bags = sorted(file for file in path.iterdir() if file.suffix in _OF_TOPICS) if path.is_dir() else []
    if bags:
        raise RecordingError(f"{path}: a bag without {_METADATA}: name its file instead, {bags[0]}")
    if topics:
        raise UsageError(
            f"--topics chooses among those of an MCAP file or a bag of ROS, but {path} is none: leave it out"
        )
    return read_recording(path)


def read_holds(path: Path, names: Sequence[str] | None = None) -> Recording:
    """Read holds that were recorded separately, from any recording, or from a file with a line for each hold.

    ``names`` are the expected robots in their order; None for any. The means in holds are its samples.
    """
    with recording_errors(path):
        means = means_in_holds(read_any(path)) if _is_of_topics(path) else read_statics(path)
        if names is None:
            return means
        if sorted(names) != sorted(means.names):
            raise RecordingError(f"found holds of {', '.join(means.names)}, expected those of {', '.join(names)}")
        return replace(means, robots={name: means.robots[name] for name in names})


def files_of(path: Path) -> list[Path]:
    """The files of a recording, which must not be overwritten."""
    if not path.is_dir():
        return [path]
    return [file for file in path.iterdir() if file.suffix.lower() in (*_OF_TOPICS, _TABLES) or file.name == _METADATA]


def _is_of_topics(path: Path) -> bool:
    return path.suffix in _OF_TOPICS or (path / _METADATA).is_file()
