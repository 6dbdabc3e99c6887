"""Reading of all kinds of recordings."""

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from coheft.errors import RecordingError, UsageError, recording_errors
from coheft.estimation.batch.recording import Recording
from coheft.estimation.batch.statics import Statics
from coheft.wire.data.file import read_recording
from coheft.wire.data.statics import read_statics

_OF_TOPICS = (".mcap", ".bag", ".db3")
_TABLES = ".csv"
_METADATA = "metadata.yaml"
"""File in each bag of ROS 2, which is a folder."""


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


def read_holds(path: Path, names: Sequence[str] | None = None) -> Statics:
    """Read holds that were recorded separately, from any recording, or from a file with a line for each hold.

    ``names`` are the expected robots in their order; None for any.
    """
    with recording_errors(path):
        statics = Statics.of_recording(read_any(path)) if _is_of_topics(path) else read_statics(path)
        return statics if names is None else statics.of(names)


def files_of(path: Path) -> list[Path]:
    """The files of a recording, which must not be overwritten."""
    if not path.is_dir():
        return [path]
    return [file for file in path.iterdir() if file.suffix.lower() in (*_OF_TOPICS, _TABLES) or file.name == _METADATA]


def _is_of_topics(path: Path) -> bool:
    return path.suffix in _OF_TOPICS or (path / _METADATA).is_file()
