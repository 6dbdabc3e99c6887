"""Files that a command writes at its end."""

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from coheft.errors import CoheftError, file_errors


def write_outputs(*outputs: tuple[Any, Callable[[Any], object]]) -> None:
    """Call each pair's function with its target, unless that is None; if one fails, the others are still called."""
    with ExitStack() as stack:
        for target, write in reversed(outputs):
            if target is not None:
                stack.callback(write, target)


def write_text(path: Path, text: str, what: str = "") -> None:
    """Write a text file, or raise a ``CoheftError`` in which ``what`` describes it, before its path."""
    with file_errors(CoheftError, f"cannot write {what}{path}"):
        path.write_text(text, encoding="utf-8")
