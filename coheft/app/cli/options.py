"""Types of arguments and options: how they are converted, checked and described."""

import math
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, TypeVar

import cyclopts
from cyclopts import Parameter
from cyclopts.validators import Number

from coheft.errors import CoheftError, UsageError

T = TypeVar("T")

Vector = Annotated[
    tuple[float, float, float], Parameter(negative=(), show_default=lambda vector: " ".join(map(str, vector)))
]
Flag = Annotated[bool, Parameter(negative=(), show_default=False)]


def _whole(_: object, tokens: Sequence[cyclopts.Token]) -> int:
    """Convert to a whole number; cyclopts would round 1.9 to 2."""
    try:
        return int(tokens[0].value)
    except ValueError:
        raise cyclopts.CoercionError(token=tokens[0], target_type=int) from None


def _path(_: object, tokens: Sequence[cyclopts.Token]) -> Path:
    """Convert to a path; an empty text, as of a variable that is not set, would mean the current folder."""
    if not tokens[0].value:
        raise ValueError("expected the name of a file or folder; found ''")
    return Path(tokens[0].value)


def _check_finite(_: object, value: float | None) -> None:
    if value is not None and not math.isfinite(value):
        raise ValueError(f"expected a finite number; found {value}")


def _if_given(check: Callable[[T], None]) -> Callable[[object, T | None], None]:
    """Return a validator that checks a value, unless it is None: then the option was not given."""
    return lambda _, value: None if value is None else check(value)


def _check_report(value: str) -> None:
    if value != "-":
        if not value or value.startswith("-"):
            raise ValueError(f"expected a file, or - for standard output; found {value!r}")
        _check_file(Path(value))


def _check_file(value: Path) -> None:
    """Check in advance that a file can be written."""
    if value.is_dir():
        raise ValueError(f"expected a file; found the folder {str(value)!r}")
    _check_parent(value)
    if not (os.access(value, os.W_OK) if value.exists() else _takes_files(value.absolute().parent)):
        raise ValueError(f"may not write {str(value)!r}")


def _check_parent(value: Path) -> None:
    if not value.absolute().parent.is_dir():
        raise ValueError(f"there is no folder {str(value.parent)!r} for {str(value)!r}: make it first")


def _check_folder(value: Path) -> None:
    there = next(place for place in (value, *value.parents) if os.path.lexists(place))
    if not there.is_dir():
        raise ValueError(f"expected a folder; found the file {str(there)!r}")
    if not _takes_files(there):
        raise ValueError(f"may not write into {str(value)!r}")


def _takes_files(folder: Path) -> bool:
    """Whether a file can be made in a folder, by trying it: permissions do not reveal read-only or special file
    systems.
    """
    from tempfile import TemporaryFile

    try:
        TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def _check_data(value: Path) -> None:
    if value.suffix == ".npz":
        _check_file(value)
        if not _takes_files(Path(os.path.realpath(value)).parent):  # an existing file is replaced, not overwritten
            raise ValueError(f"may not replace {str(value)!r}")
        return
    if value.suffix:
        raise ValueError(f"expected a file that ends with .npz, or a folder, without suffix; found {str(value)!r}")
    _check_parent(value)
    _check_folder(value)
    if value.is_dir():
        from coheft.wire.data.folder import check_folder

        try:
            check_folder(value)
        except CoheftError as error:
            raise ValueError(str(error)) from error


def _check_recording(value: Path) -> None:
    if value.suffix != ".mcap":
        raise ValueError(f"expected a file that ends with .mcap; found {str(value)!r}")
    _check_file(value)
    if value.exists():
        raise ValueError(f"{str(value)!r} exists already: give another name, or remove it")


def check_outputs(*inputs: Path, **targets: str | Path | None) -> None:
    """Raise a ``UsageError`` if two outputs of a command have the same path, or if one of them is an input.

    ``targets`` are the outputs by name of the option; None if not requested; - is standard output.
    """
    read = {os.path.realpath(path) for path in inputs}
    options: dict[str, str] = {}
    for name, target in targets.items():
        if target is None or target == "-":
            continue
        option = f"--{name.replace('_', '-')}"
        place = os.path.realpath(target)
        if place in read:
            raise UsageError(f"{option} names {str(target)!r}, which is an input: give another path")
        other = options.setdefault(place, option)
        if other != option:
            raise UsageError(f"{other} and {option} both name {str(target)!r}: give different paths")


Whole = Annotated[int, Parameter(converter=_whole)]
Count = Annotated[int, Parameter(converter=_whole, validator=Number(gte=1))]
NotNegative = Annotated[int, Parameter(converter=_whole, validator=Number(gte=0))]
Positive = Annotated[float, Parameter(validator=(Number(gt=0), _check_finite))]
NotNegativeNumber = Annotated[float, Parameter(validator=(Number(gte=0), _check_finite))]
Quiet = Annotated[bool, Parameter(negative=(), show_default=False, help="Print only errors.")]
Jobs = Annotated[
    int | None,
    Parameter(converter=_whole, validator=Number(gte=1), help="Number of processes; by default one per core."),
]
ScenarioName = Annotated[
    str, Parameter(help="Name of a shipped scenario (see 'coheft scenarios'), or a path that ends with .toml.")
]
Port = Annotated[int | None, Parameter(converter=_whole, validator=Number(gte=1, lte=65535))]
GivenPath = Annotated[Path, Parameter(converter=_path)]
RunFolder = Annotated[
    Path | None,
    Parameter(
        name="--run", converter=_path, help="Folder of the run, or its name; needed to change one of several runs."
    ),
]
ShownRun = Annotated[
    Path | None,
    Parameter(name="--run", converter=_path, help="Folder of the run, or its name; by default the newest run."),
]
ReportTarget = Annotated[
    str | None,
    Parameter(
        allow_leading_hyphen=True,
        validator=_if_given(_check_report),
        help="Write the report to this file, as JSON; - for standard output.",
    ),
]
FileTarget = Annotated[Path | None, Parameter(converter=_path, validator=_if_given(_check_file))]
NewFolder = Annotated[Path, Parameter(converter=_path, validator=_if_given(_check_folder))]
FolderTarget = Annotated[Path | None, Parameter(converter=_path, validator=_if_given(_check_folder))]
DataTarget = Annotated[Path | None, Parameter(converter=_path, validator=_if_given(_check_data))]
RecordingTarget = Annotated[Path | None, Parameter(converter=_path, validator=_if_given(_check_recording))]
