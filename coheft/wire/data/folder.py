"""Recordings as folders: a CSV file per robot, and maybe ``holds.csv``. ``docs/data-format.md`` describes them."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable
from itertools import pairwise
from pathlib import Path
from typing import BinaryIO

import numpy as np

from coheft.errors import RecordingError, one_line
from coheft.estimation.batch.recording import Recording, RobotRecord
from coheft.estimation.geometry.spatial import Array
from coheft.wire.data.checks import COLUMNS, TIME, channels_of, holds_of, robot_of
from coheft.wire.data.replace import replace_files

_HOLDS = "holds"
_HOLDS_HEADER = ("start", "end")
_END = "\r\n"
"""Of a line, as RFC 4180 has it."""


def read_folder(folder: Path) -> Recording:
    """Read a recording, all robots of which are in files of their own.

    Raises:
        RecordingError: A file cannot be used; says which, and why.
        OSError: A file cannot be read.
    """
    files = _tables(folder)
    for one, other in pairwise(files):
        if one.stem == other.stem:
            raise RecordingError(
                f"{one.name} and {other.name} are both of {one.stem}: expected one file, remove the other"
            )
    robots = {file.stem: _read_robot(file) for file in files if file.stem != _HOLDS}
    if not robots:
        raise RecordingError("no .csv files in this folder; expected one per robot")
    holds = [file for file in files if file.stem == _HOLDS]
    return Recording(robots=robots, holds=_read_holds(holds[0]) if holds else None)


def _tables(folder: Path) -> list[Path]:
    """CSV files, whether their ending is written large or small."""
    if not folder.is_dir():
        return []
    return sorted(
        (file for file in folder.iterdir() if file.suffix.lower() == ".csv"), key=lambda file: (file.stem, file.name)
    )


def write_folder(recording: Recording, folder: Path) -> None:
    """Write samples and holds, in place of the recording that is in the folder already, if there is one.

    Raises:
        RecordingError: There are CSV files which would be read as part of the recording, but are none.
        OSError: A file cannot be written.
    """
    for name in recording.robots:
        if name in ("", _HOLDS) or Path(name).name != name:
            raise RecordingError(f"robot '{one_line(name)}': no name of a file: rename it, or write an .npz file")
    folder.mkdir(parents=True, exist_ok=True)
    old = check_folder(folder)
    writers = {folder / f"{name}.csv": _robot_writer(robot) for name, robot in recording.robots.items()}
    if recording.holds is not None:
        holds = np.array(recording.holds, dtype=np.float64).reshape(-1, 2)
        writers[folder / f"{_HOLDS}.csv"] = _writer(_HOLDS_HEADER, holds)
    replace_files(writers, old)


def check_folder(folder: Path) -> list[Path]:
    """Check that a recording can be written into a folder: the files that it takes the place of.

    Raises:
        RecordingError: There are CSV files which would be read as part of the recording, but are none.
        OSError: A file cannot be read.
    """
    old = _tables(folder)
    others = [file.name for file in old if not _is_ours(file)]
    if others:
        raise RecordingError(
            f"found files there that are of no recording which coheft wrote: {one_line(', '.join(others))}; they would "
            f"be taken for a part of this one: move them, or choose another folder"
        )
    return old


def _is_ours(file: Path) -> bool:
    """Whether a file begins as the ones written here do, to the byte: what others made is not to be removed."""
    if not file.is_file():
        return False
    with file.open("rb") as opened:
        line = opened.readline(1000).decode("latin-1")
    names = line.removesuffix(_END).split(",")
    header = _HOLDS_HEADER if file.stem == _HOLDS else _header(c for c in COLUMNS if COLUMNS[c][0] in names)
    return line == ",".join(header) + _END


def _header(channels: Iterable[str]) -> tuple[str, ...]:
    return (TIME, *(column for channel in channels for column in COLUMNS[channel]))


def _robot_writer(robot: RobotRecord) -> Callable[[BinaryIO], None]:
    channels = channels_of(robot)
    return _writer(_header(channels), np.hstack([robot.time[:, None], *channels.values()]))


def _writer(header: tuple[str, ...], rows: Array) -> Callable[[BinaryIO], None]:
    """What writes a CSV file with numbers (n, columns) that are read as they were."""

    def write(file: BinaryIO) -> None:
        file.write((",".join(header) + _END).encode())
        file.writelines((",".join(map(repr, row)) + _END).encode() for row in rows.tolist())

    return write


def _read_robot(path: Path) -> RobotRecord:
    table = read_table(path)
    known = _header(COLUMNS)
    unknown = [column for column in table if column not in known]
    if unknown:
        raise RecordingError(
            f"{path.name}: column '{one_line(unknown[0])}' is unknown; allowed: {', '.join(sorted(known))}"
        )
    if not len(next(iter(table.values()))):
        raise RecordingError(f"{path.name}: expected a line with the names of columns, then numbers")
    channels: dict[str, Array] = {TIME: table[TIME]} if TIME in table else {}
    for channel, columns in COLUMNS.items():
        missing = [column for column in columns if column not in table]
        if len(missing) < len(columns):
            if missing:
                raise RecordingError(
                    f"{path.name}: '{channel}' lacks column{'s' * (len(missing) > 1)} {', '.join(missing)}"
                )
            channels[channel] = np.column_stack([table[column] for column in columns])
    return robot_of(path.stem, channels)


def _read_holds(path: Path) -> tuple[tuple[float, float], ...]:
    table = read_table(path)
    if sorted(table) != sorted(_HOLDS_HEADER):
        found = one_line(", ".join(table))
        raise RecordingError(f"{path.name}: found columns {found}; expected {', '.join(_HOLDS_HEADER)}")
    return holds_of(np.column_stack([table[column] for column in _HOLDS_HEADER]))


def read_table(path: Path) -> dict[str, Array]:
    """The columns of a CSV file, by their names; each has shape (n,), and n may be 0.

    Raises:
        RecordingError: It is no table of numbers; says where, and why.
        OSError: It cannot be read.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            lines = [(reader.line_num, row) for row in reader if any(map(str.strip, row))]
    except UnicodeDecodeError as error:
        raise RecordingError(
            f"{path.name}: not UTF-8 text ({error.reason} at byte {error.start}), but UTF-16 or Latin-1 perhaps, as "
            f"Excel exports; save it again as 'CSV UTF-8 (comma delimited)'"
        ) from error
    except csv.Error as error:
        raise RecordingError(f"{path.name}: no table of numbers separated by commas: {error}") from error
    header = [name.strip() for name in lines[0][1]] if lines else []
    if header and not header[-1]:  # lines end with a comma
        header.pop()
    if not header:
        raise RecordingError(f"{path.name}: expected a line with the names of columns, then numbers")
    if len(header) == 1 and any(other in header[0] for other in ";\t"):
        raise RecordingError(
            f"{path.name}: found '{one_line(header[0])}' as the first line, expected names separated by commas: save "
            f"it again as 'CSV UTF-8 (comma delimited)', with decimal points"
        )
    twice = [name for name in header if header.count(name) > 1]
    if twice:
        raise RecordingError(
            f"{path.name}: column '{one_line(twice[0])}' is there {header.count(twice[0])} times, expected once: "
            f"remove or rename the others"
        )
    numbers = np.empty((len(lines) - 1, len(header)))
    for i, (line, row) in enumerate(lines[1:]):
        values = row[:-1] if len(row) == len(header) + 1 and not row[-1].strip() else row
        if len(values) != len(header):
            raise RecordingError(f"{path.name}: line {line}: found {len(values)} values, expected {len(header)}")
        try:
            numbers[i] = np.array(values, dtype=np.float64)
        except ValueError:
            column, value = next(pair for pair in zip(header, values, strict=True) if not _is_number(pair[1]))
            raise RecordingError(
                f"{path.name}: line {line}, column '{one_line(column)}': found '{one_line(value)}'; expected a number "
                f"such as 1.5"
            ) from None
    return dict(zip(header, numbers.T, strict=True))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
