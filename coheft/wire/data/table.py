"""Tables of numbers in CSV files from people and programs."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from coheft.errors import RecordingError, one_line
from coheft.estimation.geometry.spatial import Array


@dataclass(frozen=True, eq=False)
class Table:
    """A CSV file with a line of names.

    Attributes:
        file: Name of the file in messages.
        names: Names of the columns.
        rows: Number of each line in the file, from 1, and its texts, as many as there are names.
    """

    file: str
    names: tuple[str, ...]
    rows: Sequence[tuple[int, Sequence[str]]]

    @property
    def listed(self) -> str:
        """Names of the columns, for a message."""
        return one_line(", ".join(self.names))

    def numbers(self, names: Sequence[str]) -> Array:
        """Return some of the columns, shape (n, columns)."""
        places = [self.names.index(name) for name in names]
        found = np.empty((len(self.rows), len(names)))
        for i, (line, row) in enumerate(self.rows):
            values = [row[place] for place in places]
            try:
                found[i] = np.array(values, dtype=np.float64)
            except ValueError:
                column, value = next(pair for pair in zip(names, values, strict=True) if not _is_number(pair[1]))
                raise RecordingError(
                    f"{self.file}: line {line}, column '{one_line(column)}': found '{one_line(value)}'; expected a "
                    f"number such as 1.5"
                ) from None
        bad = np.argwhere(~np.isfinite(found))
        if len(bad):
            (line, row), column = self.rows[bad[0, 0]], bad[0, 1]
            raise RecordingError(
                f"{self.file}: line {line}, column '{one_line(names[column])}': found '{row[places[column]]}' (in all, "
                f"{len(bad)} values are not finite); expected a number: fill gaps, or keep a part without"
            )
        return found

    def check_growing(self, time: Array, unit: str = "") -> None:
        """Check that times (n,) of the rows grow; ``unit`` is for the message."""
        falling = np.flatnonzero(~(np.diff(time) > 0.0))
        if len(falling):
            at = int(falling[0]) + 1
            raise RecordingError(
                f"{self.file}: line {self.rows[at][0]} is of {time[at]:.16g}{unit}, the one before of "
                f"{time[at - 1]:.16g}{unit} (in all, {len(falling)} are not later than the one before); expected times "
                f"that grow: sort the lines, and remove what is there twice"
            )


def read_table(path: Path) -> Table:
    """Read a CSV file. Blank lines, spaces around values, and commas at the ends of lines are ignored.

    Lines that begin with # are comments, but for one with the names of columns, as ``numpy.savetxt`` writes it.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            lines = _without_comments([(reader.line_num, row) for row in reader if any(map(str.strip, row))])
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
    if 2 * sum(map(_is_number, header)) > len(header):
        raise RecordingError(f"{path.name}: the first line holds numbers, expected the names of the columns")
    twice = [name for name in header if header.count(name) > 1]
    if twice:
        raise RecordingError(
            f"{path.name}: column '{one_line(twice[0])}' is there {header.count(twice[0])} times, expected once: "
            f"remove or rename the others"
        )
    rows = []
    for line, row in lines[1:]:
        values = row[:-1] if len(row) == len(header) + 1 and not row[-1].strip() else row
        if len(values) != len(header):
            raise RecordingError(
                f"{path.name}: line {line}: found {len(values)} values, expected {len(header)}: one for "
                f"each name in the first line, which is '{one_line(','.join(header))}'"
            )
        rows.append((line, values))
    return Table(path.name, tuple(header), rows)


def _without_comments(lines: Sequence[tuple[int, list[str]]]) -> list[tuple[int, list[str]]]:
    """Numbered lines without comments; the last comment before the numbers names the columns if nothing else does."""
    kept = [line for line in lines if not line[1][0].lstrip().startswith("#")]
    if not kept or not all(map(_is_number, filter(str.strip, kept[0][1]))):
        return kept
    before = [(number, row) for number, row in lines if number < kept[0][0]]
    if before:
        number, row = before[-1]
        kept.insert(0, (number, [row[0].lstrip().removeprefix("#"), *row[1:]]))
    return kept


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
