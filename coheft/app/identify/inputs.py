"""Recordings of all kinds that ``coheft identify`` reads."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from coheft.errors import RecordingError, UsageError
from coheft.estimation.batch.recording import Recording
from coheft.estimation.batch.statics import Statics
from coheft.wire.data.file import read_recording
from coheft.wire.data.statics import read_statics

_OF_TOPICS = (".mcap", ".bag", ".db3")
_TABLES = ".csv"
_METADATA = "metadata.yaml"
"""Of the folder that is a bag of ROS 2."""


def read_any(path: Path, topics: Sequence[str] = ()) -> Recording:
    """Read a recording: ``.npz``, a folder of CSV files, an MCAP file, or a bag of ROS.

    Args:
        path: File or folder.
        topics: Which topics are of which robot, ``ROBOT=TOPIC`` each; none: as their names say.

    Raises:
        RecordingError: It cannot be read or used; says what, and why.
        UsageError: There are topics to choose, but none in such a file.
        MissingPackageError: Topics are read by packages that are not installed.
    """
    if _is_of_topics(path):
        import_module("coheft.app.recording")  # says which package is missing, if one is
        from coheft.app.identify.recorded_topics import read_topics

        return read_topics(path, topics)
    if topics:
        raise UsageError(
            f"--topics chooses among those of an MCAP file or a bag of ROS, but {path} is none: leave it out"
        )
    return read_recording(path)


def read_holds(path: Path, names: Sequence[str] | None = None) -> Statics:
    """Read holds that were recorded apart: a file or folder as of any recording, or with a line for each hold.

    Args:
        path: File or folder.
        names: Robots that are expected, in their order; None: any.

    Raises:
        RecordingError: It cannot be read or used, or is of other robots; says what, and why.
    """
    try:
        statics = Statics.of_recording(read_any(path)) if _is_of_topics(path) else read_statics(path)
        return statics if names is None else statics.of(names)
    except RecordingError as error:
        text = str(error)
        raise RecordingError(text if text.startswith(f"{path}: ") else f"{path}: {text}") from error
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from error


def files_of(path: Path) -> list[Path]:
    """The files that a recording is in, none of which is to be written over."""
    if not path.is_dir():
        return [path]
    return [file for file in path.iterdir() if file.suffix.lower() in (*_OF_TOPICS, _TABLES) or file.name == _METADATA]


def _is_of_topics(path: Path) -> bool:
    return path.suffix in _OF_TOPICS or (path / _METADATA).is_file()
