"""Progress of a command with many runs: a bar in a terminal, a count in a narrow one, otherwise lines."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich import progress
from rich.console import Console
from rich.table import Column

_LINES = 10  # at most, without a terminal
_WIDTH_OF_A_BAR = 50
"""Smallest width of a window with room for a bar and times."""


@contextmanager
def show_progress(console: Console, what: str, total: int) -> Iterator[Callable[..., None]]:
    """Show progress while the context lasts, unless the console is quiet; ``what`` names the items that are counted.

    Yields a function to call after each item, if necessary with a remark.
    """
    if console.quiet:
        yield lambda remark="": None
    elif console.is_terminal:
        columns: list[progress.ProgressColumn] = [
            progress.TextColumn("{task.description}"),
            progress.BarColumn(),
            progress.MofNCompleteColumn(),
            progress.TimeElapsedColumn(),
            progress.TimeRemainingColumn(),
        ]
        if console.width < _WIDTH_OF_A_BAR:
            columns = [progress.TextColumn("{task.completed}/{task.total}, {task.description}", table_column=Column())]
        with progress.Progress(*columns, console=console) as shown:
            bar = shown.add_task(what, total=total)
            yield lambda remark="": shown.update(bar, advance=1, description=remark or what)
    else:
        yield _lines(console, what, total)


def _lines(console: Console, what: str, total: int) -> Callable[..., None]:
    """Return a function that prints a line for each tenth that is done."""
    done = written = 0

    def tell(remark: str = "") -> None:
        nonlocal done, written
        done += 1
        if (tenths := done * _LINES // total) > written:
            written = tenths
            text = f"{done} of {total} {what}{', ' * bool(remark)}{remark}"
            console.print(text, markup=False, highlight=False, soft_wrap=True)

    return tell
