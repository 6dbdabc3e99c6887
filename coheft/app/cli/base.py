"""What all commands share: the application, exit statuses, kinds of arguments."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import cyclopts
from cyclopts import Parameter
from cyclopts.validators import Number

import coheft
from coheft.errors import CoheftError, UsageError

EXIT_CONVERGED = 0
EXIT_ERROR = 1
EXIT_USAGE = 2
EXIT_NOT_CONVERGED = 3
EXIT_BROKEN_PROMISE = 4
EXIT_INTERRUPTED = 130

EXIT_MEANINGS = {
    EXIT_CONVERGED: "every robot converged (or: done)",
    EXIT_ERROR: "an error",
    EXIT_USAGE: "wrong usage or a bad scenario",
    EXIT_NOT_CONVERGED: "not every robot converged, or one is further off than it claims (or: not all was reached)",
    EXIT_BROKEN_PROMISE: "a promise was broken",
    EXIT_INTERRUPTED: "stopped by Ctrl-C",
}

RUN = cyclopts.Group.create_ordered("Run")
CONTROL = cyclopts.Group.create_ordered("Control a run in progress")
EVALUATE = cyclopts.Group.create_ordered("Evaluate")
PARTS = cyclopts.Group.create_ordered("Start parts by hand, on one or several hosts")
SHELL = cyclopts.Group.create_ordered("The command line itself")

app = cyclopts.App(
    name="coheft",
    help="Robots that hold a load together identify it by themselves.",
    help_epilogue=f"Exit status: {', '.join(f'{status} {meaning}' for status, meaning in EXIT_MEANINGS.items())}.",
    version=coheft.__version__,
    group_commands=SHELL,
    suppress_keyboard_interrupt=False,  # what Ctrl-C means is up to ``run_command_line``
)

Vector = Annotated[
    tuple[float, float, float], Parameter(negative=(), show_default=lambda vector: " ".join(map(str, vector)))
]
Flag = Annotated[bool, Parameter(negative=(), show_default=False)]


def _whole(_: object, tokens: Sequence[cyclopts.Token]) -> int:
    """Cyclopts would round 1.9 to 2."""
    try:
        return int(tokens[0].value)
    except ValueError:
        raise cyclopts.CoercionError(token=tokens[0], target_type=int) from None


def _path(_: object, tokens: Sequence[cyclopts.Token]) -> Path:
    """An empty name, as of a variable that is not set, would be that of the current folder."""
    if not tokens[0].value:
        raise ValueError("expected the name of a file or folder; found ''")
    return Path(tokens[0].value)


def _is_target(_: object, value: str | None) -> None:
    if value is None or value == "-":
        return
    if not value or value.startswith("-"):
        raise ValueError(f"expected a file, or - for standard output; found {value!r}")
    _check_file(Path(value))


def _is_file(_: object, value: Path | None) -> None:
    if value is not None:
        _check_file(value)


def _check_file(value: Path) -> None:
    """Check, before anything that takes long, that a file can be written there."""
    if value.is_dir():
        raise ValueError(f"expected a file; found the folder {str(value)!r}")
    _check_parent(value)
    if not (os.access(value, os.W_OK) if value.exists() else _takes_files(value.absolute().parent)):
        raise ValueError(f"may not write {str(value)!r}")


def _check_parent(value: Path) -> None:
    if not value.absolute().parent.is_dir():
        raise ValueError(f"there is no folder {str(value.parent)!r} to write {str(value)!r} into")


def _is_folder(_: object, value: Path | None) -> None:
    if value is None:
        return
    there = next(place for place in (value, *value.parents) if os.path.lexists(place))
    if not there.is_dir():
        raise ValueError(f"expected a folder; found the file {str(there)!r}")
    if not _takes_files(there):
        raise ValueError(f"may not write into {str(value)!r}")


def _takes_files(folder: Path) -> bool:
    """Tried out: permissions alone do not tell it of file systems that are read-only or special."""
    from tempfile import TemporaryFile

    try:
        TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def _is_data_target(kind: object, value: Path | None) -> None:
    if value is None:
        return
    if value.suffix == ".npz":
        _check_file(value)
        if not _takes_files(Path(os.path.realpath(value)).parent):  # what is there is replaced, not written to
            raise ValueError(f"may not replace {str(value)!r}")
        return
    if value.suffix:
        raise ValueError(f"expected a file that ends with .npz, or a folder, without suffix; found {str(value)!r}")
    _check_parent(value)
    _is_folder(kind, value)
    if value.is_dir():
        from coheft.wire.data.folder import check_folder

        try:
            check_folder(value)
        except CoheftError as error:
            raise ValueError(str(error)) from error


def _is_new_recording(kind: object, value: Path | None) -> None:
    if value is None:
        return
    if value.suffix != ".mcap":
        raise ValueError(f"expected a file that ends with .mcap; found {str(value)!r}")
    _is_file(kind, value)
    if value.exists():
        raise ValueError(f"{str(value)!r} is there already: give another name, or remove it")


def check_outputs(*inputs: Path, **targets: str | Path | None) -> None:
    """Check that no two outputs of a command go to the same place, and none to where something is read.

    Args:
        inputs: Files that are read.
        targets: Where outputs go, by the names of their options; None: nowhere; - is standard output.

    Raises:
        UsageError: One does.
    """
    read = {os.path.realpath(path) for path in inputs}
    options: dict[str, str] = {}
    for name, target in targets.items():
        if target is None or target == "-":
            continue
        option = f"--{name.replace('_', '-')}"
        place = os.path.realpath(target)
        if place in read:
            raise UsageError(f"{option} names {str(target)!r}, which is read: give it a place of its own")
        other = options.setdefault(place, option)
        if other != option:
            raise UsageError(f"{other} and {option} both name {str(target)!r}: give each a place of its own")


Whole = Annotated[int, Parameter(converter=_whole)]
Count = Annotated[int, Parameter(converter=_whole, validator=Number(gte=1))]
NotNegative = Annotated[int, Parameter(converter=_whole, validator=Number(gte=0))]
Positive = Annotated[float, Parameter(validator=Number(gt=0))]
NotNegativeNumber = Annotated[float, Parameter(validator=Number(gte=0))]
Port = Annotated[int | None, Parameter(converter=_whole, validator=Number(gte=1, lte=65535))]
GivenPath = Annotated[Path, Parameter(converter=_path)]
RunFolder = Annotated[
    Path | None,
    Parameter(
        name="--run", converter=_path, help="Folder of the run, or its name; needed to change one of several runs."
    ),
]
ReportTarget = Annotated[str | None, Parameter(allow_leading_hyphen=True, validator=_is_target)]
FileTarget = Annotated[Path | None, Parameter(converter=_path, validator=_is_file)]
NewFolder = Annotated[Path, Parameter(converter=_path, validator=_is_folder)]
FolderTarget = Annotated[Path | None, Parameter(converter=_path, validator=_is_folder)]
DataTarget = Annotated[Path | None, Parameter(converter=_path, validator=_is_data_target)]
RecordingTarget = Annotated[Path | None, Parameter(converter=_path, validator=_is_new_recording)]
