"""Progress of a command with many runs: a bar in a terminal, a count in a narrow one, otherwise lines."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Column

_LINES = 10
"""Largest number of lines without a terminal."""
_WIDTH_OF_A_BAR = 50
"""Smallest width of a window with room for a bar and times."""


@contextmanager
def show_progress(console: Console, what: str, total: int, *, quiet: bool) -> Iterator[Callable[[int, str], None]]:
    """Show progress while the context lasts.

    Args:
        console: The console to print to.
        what: Name of the items that are counted.
        total: Their number.
        quiet: Whether to show nothing.

    Yields:
        A function to call with the number of finished items and a remark, which may be empty.
    """
    if quiet:
        yield lambda done, remark: None
    elif console.is_terminal:
        columns: list[ProgressColumn] = [
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
        ]
        if console.width < _WIDTH_OF_A_BAR:
            columns = [TextColumn("{task.completed}/{task.total}, {task.description}", table_column=Column())]
        with Progress(*columns, console=console) as progress:
            bar = progress.add_task(what, total=total)
            yield lambda done, remark: progress.update(bar, completed=done, description=remark or what)
    else:
        yield _Lines(console, what, total)


class _Lines:
    """Prints a line for each tenth that is done."""

    def __init__(self, console: Console, what: str, total: int) -> None:
        self._console = console
        self._what = what
        self._total = total
        self._written = 0

    def __call__(self, done: int, remark: str) -> None:
        tenths = done * _LINES // self._total
        if tenths > self._written:
            self._written = tenths
            text = f"{done} of {self._total} {self._what}{', ' * bool(remark)}{remark}"
            self._console.print(text, markup=False, highlight=False, soft_wrap=True)
