"""Our errors beside the paper's tables, in the terminal and as Markdown."""

from collections.abc import Iterator

import numpy as np
from rich.console import Console

from coheft.app.identify.choices import Method
from coheft.app.mocobots.campaign import PAPER, ROWS, Mocobots, Noise
from coheft.app.study.tables import markdown_table
from coheft.app.terminal.wide_table import bare_table, print_table
from coheft.estimation.geometry.spatial import Array

_TABLES = (
    ("Table II: rotations, degrees", slice(0, 3)),
    ("Table III: positions, mm", slice(3, 6)),
    ("Table IV: mass, kg, and centre of mass, mm", slice(6, 8)),
    ("Table V: principal inertias, %", slice(8, 11)),
)
_COLUMNS: tuple[tuple[str, Noise, Method], ...] = (
    ("least squares, vibration", "vibration", "batch"),
    ("instruments, vibration", "vibration", "instruments"),
    ("pose, vibration", "vibration", "pose"),
    ("least squares, calibration errors", "calibration", "batch"),
    ("pose with calibration, calibration errors", "calibration", "pose"),
)
_DIGITS = (3, 3, 3, 2, 2, 2, 4, 2, 2, 2, 2)
"""Digits after the point, by row."""
_KINDS = (
    ("rotations, °", slice(0, 3)),
    ("positions, mm", slice(3, 6)),
    ("mass, kg", slice(6, 7)),
    ("centre of mass, mm", slice(7, 8)),
    ("principal inertias, %", slice(8, 11)),
)
"""Kinds of rows."""


def print_tables(console: Console, found: Mocobots) -> None:
    """Print a summary, mean (worst), then our errors beside the paper's on hardware."""
    table = bare_table("Absolute errors of all payloads: mean, and in brackets the worst", gap=1)
    for heading in ("", "rotations, °", "positions, mm", "mass, kg", "centre, mm", "inertias, %"):
        table.add_column(heading, justify="right" if heading else "left", no_wrap=bool(heading))
    for name, errors in _together(found):
        table.add_row(_heading(name), *(f"{_short(each.mean())} ({_short(each.max())})" for each in errors))
    print_table(console, table)
    for title, rows in _TABLES:
        table = bare_table(title, gap=1)
        for heading in ("", "paper", *(_heading(name) for name, _, _ in _COLUMNS)):
            table.add_column(heading, justify="right" if heading else "left", no_wrap=not heading)
        for configuration, row, each in _compared(found, rows):
            ours = (_short(typical(errors, row)) for errors in each)
            table.add_row(_label(configuration, row), _short(PAPER[configuration][row]), *ours)
        console.print()
        print_table(console, table)
    console.print(
        "*: with calibration errors; others: vibration alone. a to d: payloads. Paper: on hardware. Tables II to V: "
        "means of absolute errors; of inertias, root mean squares.",
        style="dim",
        highlight=False,
    )


def markdown(found: Mocobots) -> str:
    """All tables: a summary, then the paper's errors on hardware beside ours, mean (worst) over the experiments."""
    digits = [_DIGITS[rows.start] for _, rows in _KINDS]
    lines = [
        (name, *(f"{each.mean():.{n}f} ({each.max():.{n}f})" for each, n in zip(errors, digits, strict=True)))
        for name, errors in _together(found)
    ]
    parts = [f"### All configurations together\n\n{markdown_table(('', *(kind for kind, _ in _KINDS)), lines)}"]
    header = ("", "paper, hardware", *(name for name, _, _ in _COLUMNS))
    for title, rows in _TABLES:
        lines = []
        for configuration, row, each in _compared(found, rows):
            n = _DIGITS[row]
            ours = (f"{typical(errors, row):.{n}f} ({np.abs(errors).max():.{n}f})" for errors in each)
            lines.append((_label(configuration, row), f"{PAPER[configuration][row]:.{n}g}", *ours))
        parts.append(f"### {title}\n\n{markdown_table(header, lines)}")
    return "\n\n".join(parts) + "\n"


def _short(value: float) -> str:
    return f"{value:.0f}" if value >= 99.5 else f"{value:#.2g}".rstrip(".")


def _heading(name: str) -> str:
    return name.removesuffix(", vibration").replace(", calibration errors", "*")


def _label(configuration: str, row: int) -> str:
    return f"{configuration}, {ROWS[row].rpartition(',')[0]}"


def _configurations(found: Mocobots) -> list[str]:
    return sorted({trial.configuration for trial in found.trials})


def _together(found: Mocobots) -> Iterator[tuple[str, list[Array]]]:
    """Yield each method's name, and the absolute errors of each kind of rows in all configurations."""
    for name, noise, method in _COLUMNS:
        each = [found.rows(configuration, noise, method) for configuration in _configurations(found)]
        yield name, [np.abs(np.concatenate(each)[:, rows]) for _, rows in _KINDS]


def _compared(found: Mocobots, rows: slice) -> Iterator[tuple[str, int, list[Array]]]:
    """Yield each configuration's rows with the errors of each method."""
    for configuration in _configurations(found):
        each = [found.rows(configuration, noise, method) for _, noise, method in _COLUMNS]
        for row in range(*rows.indices(len(ROWS))):
            yield configuration, row, [errors[:, row] for errors in each]


def typical(errors: Array, row: int) -> float:
    """The statistic that the paper gives for a row: the mean, or for inertias the root mean square."""
    return float(np.sqrt(np.mean(errors**2)) if row >= 8 else np.mean(np.abs(errors)))


def worse_than_paper(found: Mocobots, noise: Noise, method: Method) -> list[str]:
    """Rows in which a method is worse than the paper, as sentences."""
    worse = []
    for configuration in _configurations(found):
        errors = found.rows(configuration, noise, method)
        for row, (name, limit) in enumerate(zip(ROWS, PAPER[configuration], strict=True)):
            value = typical(errors[:, row], row)
            if value > limit:
                worse.append(f"{configuration}, {name}: {value:.3g}, paper {limit:.3g}")
    return worse
