"""Our errors beside the paper's tables, as Markdown."""

from collections.abc import Sequence

import numpy as np

from coheft.app.identify.choices import Method
from coheft.app.mocobots.campaign import Mocobots, Noise
from coheft.app.mocobots.paper import PAPER, ROWS
from coheft.app.study.tables import markdown_table
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


def markdown(found: Mocobots) -> str:
    """All tables: a summary, then the paper's errors on hardware beside ours, mean (worst) over the experiments."""
    configurations = sorted({trial.configuration for trial in found.trials})
    parts = [_in_short(found, configurations)]
    for title, rows in _TABLES:
        header = ("", "paper, hardware", *(name for name, _, _ in _COLUMNS))
        lines = []
        for configuration in configurations:
            for row in range(*rows.indices(len(ROWS))):
                label = ROWS[row].rpartition(",")[0]
                cells = [f"{configuration}, {label}", f"{PAPER[configuration][row]:.{_DIGITS[row]}g}"]
                for _, noise, method in _COLUMNS:
                    errors = found.rows(configuration, noise, method)[:, row]
                    cells.append(f"{typical(errors, row):.{_DIGITS[row]}f} ({np.abs(errors).max():.{_DIGITS[row]}f})")
                lines.append(tuple(cells))
        parts.append(f"### {title}\n\n{markdown_table(header, lines)}")
    return "\n\n".join(parts) + "\n"


def _in_short(found: Mocobots, configurations: Sequence[str]) -> str:
    """Mean (worst) absolute errors of all configurations together."""
    lines = []
    for name, noise, method in _COLUMNS:
        errors = np.abs(np.concatenate([found.rows(configuration, noise, method) for configuration in configurations]))
        cells = [name]
        for _, rows in _KINDS:
            own, digits = errors[:, rows], _DIGITS[rows.start]
            cells.append(f"{own.mean():.{digits}f} ({own.max():.{digits}f})")
        lines.append(tuple(cells))
    table = markdown_table(("", *(kind for kind, _ in _KINDS)), lines)
    return f"### All configurations together\n\n{table}"


def typical(errors: Array, row: int) -> float:
    """The statistic that the paper gives for a row: the mean, or for inertias the root mean square."""
    return float(np.sqrt(np.mean(errors**2)) if row >= 8 else np.mean(np.abs(errors)))


def worse_than_paper(found: Mocobots, noise: Noise, method: Method) -> list[str]:
    """Rows in which a method is worse than the paper, as sentences."""
    worse = []
    for configuration in sorted({trial.configuration for trial in found.trials}):
        errors = found.rows(configuration, noise, method)
        for row, (name, limit) in enumerate(zip(ROWS, PAPER[configuration], strict=True)):
            value = typical(errors[:, row], row)
            if value > limit:
                worse.append(f"{configuration}, {name}: {value:.3g}, paper {limit:.3g}")
    return worse
