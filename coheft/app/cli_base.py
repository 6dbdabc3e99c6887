"""What all commands share: the application, exit statuses, kinds of arguments."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import cyclopts
from cyclopts import Parameter
from cyclopts.validators import Number

import coheft

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
    EXIT_NOT_CONVERGED: "not every robot had converged at the end (or: not all was reached)",
    EXIT_BROKEN_PROMISE: "a promise was broken",
    EXIT_INTERRUPTED: "stopped by Ctrl-C",
}

RUN = cyclopts.Group.create_ordered("Run")
CONTROL = cyclopts.Group.create_ordered("A run that goes on")
EVALUATE = cyclopts.Group.create_ordered("Evaluate")
PARTS = cyclopts.Group.create_ordered("Parts by hand, several hosts")
SHELL = cyclopts.Group.create_ordered("This command line")

app = cyclopts.App(
    name="coheft",
    help="Robots that hold one load together find out, by themselves, what they are holding.",
    help_epilogue=f"Exit status: {', '.join(f'{status} {meaning}' for status, meaning in EXIT_MEANINGS.items())}.",
    version=coheft.__version__,
    group_commands=SHELL,
    suppress_keyboard_interrupt=False,  # what Ctrl-C means is up to ``run_command_line``
)

Vector = Annotated[tuple[float, float, float], Parameter(negative=())]
RunFolder = Annotated[Path | None, Parameter(name="--run", help="Folder of the run, if it is not the newest of yours.")]
Flag = Annotated[bool, Parameter(negative=(), show_default=False)]


def _is_target(_: object, value: str | None) -> None:
    if value is None or value == "-":
        return
    if value.startswith("-"):
        raise ValueError(f"expected a file, or - for standard output; found {value!r}")
    if not Path(value).absolute().parent.is_dir():
        raise ValueError(f"there is no folder {str(Path(value).parent)!r} to write {value!r} into")


def _has_folder(_: object, value: Path | None) -> None:
    if value is not None and not value.absolute().parent.is_dir():
        raise ValueError(f"there is no folder {str(value.parent)!r} to write {str(value)!r} into")
    if value is not None and not os.access(value if value.is_dir() else value.absolute().parent, os.W_OK):
        raise ValueError(f"may not write {str(value)!r}")


def _is_new_recording(kind: object, value: Path | None) -> None:
    _has_folder(kind, value)
    if value is None:
        return
    if value.suffix != ".mcap":
        raise ValueError(f"expected a file that ends with .mcap; found {str(value)!r}")
    if value.exists():
        raise ValueError(f"{str(value)!r} is there already: give another name, or remove it")


Count = Annotated[int, Parameter(validator=Number(gte=1))]
NotNegative = Annotated[int, Parameter(validator=Number(gte=0))]
Positive = Annotated[float, Parameter(validator=Number(gt=0))]
Port = Annotated[int | None, Parameter(validator=Number(gte=1, lte=65535))]
ReportTarget = Annotated[str | None, Parameter(allow_leading_hyphen=True, validator=_is_target)]
DataTarget = Annotated[Path | None, Parameter(validator=_has_folder)]
RecordingTarget = Annotated[Path | None, Parameter(validator=_is_new_recording)]
