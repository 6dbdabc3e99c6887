"""Tables that are complete in any window: if they do not fit, each value is printed on a line of its own."""

from rich.console import Console, RenderableType
from rich.measure import Measurement
from rich.table import Column, Table
from rich.text import Text

_ANY = 10_000
"""A width at which every table fits."""


def bare_table(title: str, gap: int) -> Table:
    """Return a table without lines, with a bold title and headings, and a gap between its columns."""
    table = Table(title=title, title_justify="left", box=None, padding=(0, gap, 0, 0))
    table.header_style = table.title_style = "bold"
    return table


def print_table(console: Console, table: Table) -> None:
    """Print a table of plain texts without cutting any of them.

    Cells wrap between words, unless their column has ``no_wrap``. If the window is still too narrow, each value gets a
    line of its own. Without a window, the table is as wide as necessary.
    """
    needed = needed_width(console, table)
    if needed > console.width and console.is_terminal:
        _print_lines(console, table)
        return
    ranges = [_widths(console, column) for column in table.columns]
    given = [least for least, _ in ranges]
    edges = needed - sum(given)
    for widest in range(console.width + 1):  # rich itself would break words to make the widest columns narrower
        wider = [max(least, min(most, widest)) for least, most in ranges]
        if sum(wider) + edges <= console.width:
            given = wider
    for column, width in zip(table.columns, given, strict=True):
        column.min_width = column.max_width = width
    table.width = sum(given) + edges
    console.print(table, crop=False)


def needed_width(console: Console, table: Table) -> int:
    """Return the smallest width of a window for a table."""
    return full_width(console, table) - sum(_widths(console, column).span for column in table.columns)


def full_width(console: Console, table: Table) -> int:
    """Return the smallest width of a window for a table in which no cell wraps."""
    return Measurement.get(console, console.options.update(width=_ANY), table).maximum


def _widths(console: Console, column: Column) -> Measurement:
    """Return the widths of a column without padding: the smallest one without broken words, and the one without
    wrapping.
    """

    def measure(cell: RenderableType) -> Measurement:
        return Measurement.get(console, console.options.update(width=_ANY), cell)

    found = [measure(cell) for cell in (column.header, *column.cells)]
    most = max(column.min_width or 0, *(each.maximum for each in found))
    least = most if column.no_wrap else max(each.minimum for each in found)
    return Measurement(max(column.min_width or 0, least), most)


def _print_lines(console: Console, table: Table) -> None:
    """Print a line for each value, and an empty line after each row."""
    if table.title is not None:
        console.print(table.title, style=table.title_style or "bold", highlight=False)
    for row in zip(*(column.cells for column in table.columns), strict=True):
        for column, cell in zip(table.columns, row, strict=True):
            if str(cell):
                heading = f"{column.header}: " if column.header else ""
                console.print(Text.assemble((heading, "bold"), str(cell)))
        console.print()
