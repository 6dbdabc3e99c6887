"""Recordings as folders: a CSV file per robot, or per ROS topic, and optionally ``holds.csv``.

``docs/data-format.md`` describes them.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import BinaryIO

import numpy as np

from coheft.errors import RecordingError, one_line
from coheft.estimation.batch.alignment import Stream
from coheft.estimation.batch.recording import Recording, RobotRecord, check_recording
from coheft.estimation.geometry.spatial import Array
from coheft.wire.data.checks import COLUMNS, TIME, channels_of, holds_of, robot_of
from coheft.wire.data.replace import replace_files
from coheft.wire.data.ros_columns import is_of_ros, robot_named, streams_of
from coheft.wire.data.table import Table, read_table
from coheft.wire.data.times import align, at_common_times, holds_in_seconds, span_of, streams_of_robot
from coheft.wire.process.log import LOG

_HOLDS = "holds"
_TIMES = {"time": TIME, "timestamp": TIME}
"""Other names of the column of times."""
_HOLDS_HEADER = ("start", "end")
_END = "\r\n"
"""End of a line by RFC 4180."""


def read_folder(folder: Path) -> Recording:
    """Read and check a recording with separate files for each robot."""
    files = _tables(folder)
    for one, other in pairwise(files):
        if one.stem == other.stem:
            raise RecordingError(
                f"{one.name} and {other.name} are both of {one.stem}: expected one file, remove the other"
            )
    robots, since = _read_robots([file for file in files if file.stem != _HOLDS])
    if not robots:
        raise RecordingError("no .csv files in this folder; expected one per robot")
    holds = [file for file in files if file.stem == _HOLDS]
    recording = Recording(robots=robots, holds=_holds_in(holds[0], robots, since) if holds else None)
    check_recording(recording)
    return recording


def _holds_in(file: Path, robots: Mapping[str, RobotRecord], since: float) -> tuple[tuple[float, float], ...]:
    """Return holds in the time of the samples, which count from ``since`` [s]; holds may count from there or from 0."""
    table, (start, end) = read_table(file), span_of(robots)
    if sorted(table.names) != sorted(_HOLDS_HEADER):
        raise RecordingError(f"{file.name}: found columns {table.listed}; expected {', '.join(_HOLDS_HEADER)}")
    holds = holds_of(table.numbers(_HOLDS_HEADER))
    try:
        whole = holds_in_seconds(file.name, holds, (since + start, since + end))
    except RecordingError:
        return holds_in_seconds(file.name, holds, (start, end))
    return tuple((begin - since, over - since) for begin, over in whole)


def _tables(folder: Path) -> list[Path]:
    """Return CSV files, with endings in upper or lower case."""
    if not folder.is_dir():
        return []
    return sorted(
        (f for f in folder.iterdir() if f.suffix.lower() == ".csv" and not f.name.startswith(".")),
        key=lambda file: (file.stem, file.name),
    )


def write_folder(recording: Recording, folder: Path) -> None:
    """Write samples and holds, replacing a recording in the folder."""
    for name in recording.robots:
        if name in ("", _HOLDS) or Path(name).name != name:
            raise RecordingError(f"robot '{one_line(name)}': no name of a file: rename it, or write an .npz file")
    folder.mkdir(parents=True, exist_ok=True)
    old = check_folder(folder)
    writers = {}
    for name, robot in recording.robots.items():
        channels = channels_of(robot)
        samples = np.hstack([robot.time[:, None], *channels.values()])
        writers[folder / f"{name}.csv"] = _writer(_header(channels), samples)
    if recording.holds is not None:
        holds = np.array(recording.holds, dtype=np.float64).reshape(-1, 2)
        writers[folder / f"{_HOLDS}.csv"] = _writer(_HOLDS_HEADER, holds)
    replace_files(writers, old)


def check_folder(folder: Path) -> list[Path]:
    """Check that a recording can be written into a folder; return the files that it replaces."""
    old = _tables(folder)
    others = [file.name for file in old if not _is_ours(file)]
    if others:
        raise RecordingError(
            f"found files there that are of no recording which coheft wrote: {one_line(', '.join(others))}; they would "
            f"be taken for a part of this one: move them, or choose another folder"
        )
    return old


def _is_ours(file: Path) -> bool:
    """Whether a file begins exactly as those written here: other files are not removed."""
    if not file.is_file():
        return False
    with file.open("rb") as opened:
        line = opened.readline(1000).decode("latin-1")
    names = line.removesuffix(_END).split(",")
    header = _HOLDS_HEADER if file.stem == _HOLDS else _header(c for c in COLUMNS if COLUMNS[c][0] in names)
    return line == ",".join(header) + _END


def _header(channels: Iterable[str]) -> tuple[str, ...]:
    return (TIME, *(column for channel in channels for column in COLUMNS[channel]))


def _writer(header: tuple[str, ...], rows: Array) -> Callable[[BinaryIO], None]:
    """Return a function that writes a CSV file of numbers (n, columns) without loss of precision."""

    def write(file: BinaryIO) -> None:
        file.write((",".join(header) + _END).encode())
        file.writelines((",".join(map(repr, row)) + _END).encode() for row in rows.tolist())

    return write


def _read_robots(files: Sequence[Path]) -> tuple[dict[str, RobotRecord], float]:
    """Return robots by name, and the start of their times [s]: not 0 if clocks count from 1970, as in ROS."""
    tables = {file: read_table(file) for file in files}
    if not any(is_of_ros(table) for table in tables.values()):
        return at_common_times({file.stem: _robot_of(file.stem, table) for file, table in tables.items()}), 0.0
    streams: dict[str, dict[str, Stream]] = {}
    for file, table in tables.items():
        is_topic = is_of_ros(table)
        name = robot_named(file.stem) if is_topic else file.stem
        found = streams_of(table) if is_topic else streams_of_robot(_robot_of(name, table))
        own = streams.setdefault(name, {})
        for channel, stream in found.items():
            if channel in own:
                raise RecordingError(
                    f"{file.name}: a second '{channel}' of {name}, expected one: files of one robot are named "
                    f"ROBOT_wrench.csv and ROBOT_pose.csv"
                )
            own[channel] = stream
    each = one_line("; ".join(f"{name}: {', '.join(own)}" for name, own in streams.items()))
    if len(streams) > 1 and max(map(len, streams.values())) == 1 and len(set(map(tuple, streams.values()))) > 1:
        raise RecordingError(
            f"found a robot for each file ({each}); expected files of one robot to be named alike, as ROBOT_wrench.csv "
            f"and ROBOT_pose.csv"
        )
    LOG.warning(f"coheft: files are taken for topics as 'rostopic echo -p' writes them, by their names of {each}")
    return align(streams)


def _robot_of(name: str, table: Table) -> RobotRecord:
    channels = _channels(_known(table))
    if TIME in channels:
        table.check_growing(channels[TIME])
    return robot_of(name, channels)


def read_channels(folder: Path) -> dict[str, dict[str, Array]]:
    """Return each robot's channels in the files of a folder, unchanged, possibly without times."""
    return {file.stem: _channels(_known(read_table(file))) for file in _tables(folder) if file.stem != _HOLDS}


def _known(table: Table) -> Table:
    """Return a table with names as in ``COLUMNS``, if all of its columns are known."""
    known = _header(COLUMNS)
    names = [_TIMES.get(column.lower(), column.lower()) for column in table.names]
    unknown = [column for column, name in zip(table.names, names, strict=True) if name not in known]
    if "" in unknown:
        raise RecordingError(
            f"{table.file}: found a column without a name, expected one for each: pandas writes its index like that "
            f"unless told index=False"
        )
    if unknown:
        raise RecordingError(
            f"{table.file}: column '{one_line(unknown[0])}' is unknown; found {table.listed}; "
            f"allowed: {', '.join(sorted(known))}, or those that 'rostopic echo -p' writes: rename it, or remove it"
        )
    twice = [column for column, name in zip(table.names, names, strict=True) if names.count(name) > 1]
    if twice:
        raise RecordingError(f"{table.file}: columns {', '.join(twice)} all are {names[table.names.index(twice[0])]}")
    return replace(table, names=tuple(names))


def _channels(table: Table) -> dict[str, Array]:
    """Return a robot's recorded channels, with ``t`` if there are times."""
    if not table.rows:
        raise RecordingError(f"{table.file}: expected a line with the names of columns, then numbers")
    channels: dict[str, Array] = {TIME: table.numbers([TIME])[:, 0]} if TIME in table.names else {}
    for channel, columns in COLUMNS.items():
        missing = [column for column in columns if column not in table.names]
        if len(missing) < len(columns):
            if missing:
                raise RecordingError(
                    f"{table.file}: '{channel}' lacks column{'s' * (len(missing) > 1)} {', '.join(missing)}; found "
                    f"{table.listed}"
                )
            channels[channel] = table.numbers(columns)
    return channels
