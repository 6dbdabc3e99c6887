"""Tables that are complete in any window: as they are where they fit, else a line for each value."""

from __future__ import annotations

from rich.console import Console, RenderableType
from rich.measure import Measurement
from rich.table import Column, Table
from rich.text import Text

_ANY = 10_000
"""Columns of a window in which everything fits."""


def print_table(console: Console, table: Table) -> None:
    """Print a table of plain texts; nothing of it is ever cut.

    Cells wrap between words, unless their column says ``no_wrap``. If the window is too narrow for that, there is a
    line for each value instead. Where there is no window, the table is as wide as it has to be.
    """
    needed = needed_width(console, table)
    if needed > console.width and console.is_terminal:
        _print_lines(console, table)
        return
    ranges = [_widths(console, column) for column in table.columns]
    given = [least for least, _ in ranges]
    edges = needed - sum(given)
    for widest in range(console.width + 1):  # rich alone would break words to make the widest columns narrower
        wider = [max(least, min(most, widest)) for least, most in ranges]
        if sum(wider) + edges <= console.width:
            given = wider
    for column, width in zip(table.columns, given, strict=True):
        column.min_width = column.max_width = width
    table.width = sum(given) + edges
    console.print(table, crop=False)


def needed_width(console: Console, table: Table) -> int:
    """Columns of a window that a table needs at least."""
    everything = Measurement.get(console, console.options.update(width=_ANY), table).maximum
    return everything - sum(_widths(console, column).span for column in table.columns)


def _widths(console: Console, column: Column) -> Measurement:
    """Of a column without padding: the least in which no word is broken, and that in which nothing wraps."""

    def measure(cell: RenderableType) -> Measurement:
        return Measurement.get(console, console.options.update(width=_ANY), cell)

    found = [measure(cell) for cell in (column.header, *column.cells)]
    most = max(column.min_width or 0, *(each.maximum for each in found))
    least = most if column.no_wrap else max(each.minimum for each in found)
    return Measurement(max(column.min_width or 0, least), most)


def _print_lines(console: Console, table: Table) -> None:
    """A line for each value, an empty one after each row."""
    if table.title is not None:
        console.print(table.title, style=table.title_style or "bold", highlight=False)
    for row in zip(*(column.cells for column in table.columns), strict=True):
        for column, cell in zip(table.columns, row, strict=True):
            if str(cell):
                heading = f"{column.header}: " if column.header else ""
                console.print(Text.assemble((heading, "bold"), str(cell)))
        console.print()
