"""Errors over time, each beside three of the robot's own standard deviations."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from coheft.app.figures import Theme
from coheft.app.results.quantities import QUANTITIES, Quantity
from coheft.app.results.report import Report
from coheft.app.results.states import State
from coheft.app.run_report.panels import mark_changes, robots_shown, use_logarithm
from coheft.app.run_report.points import sizes
from coheft.app.run_report.series import Series
from coheft.estimation.geometry.spatial import Array


@dataclass(frozen=True)
class Shown:
    """How a quantity is shown.

    Attributes:
        name: Of its picture.
        quantity: What is shown.
        title: Above the picture.
        unit: In which it is shown.
        per_unit: How many of these make one of the quantity's own.
    """

    name: str
    quantity: Quantity
    title: str
    unit: str
    per_unit: float


_ROTATION, _TRANSLATION, _MASS, _COM, _INERTIA = QUANTITIES
COM_SHOWN = Shown("centre-of-mass", _COM, "Centre of mass", "mm", 1e3)
ALL_SHOWN = (
    Shown("mass", _MASS, "Mass", "g", 1e3),
    COM_SHOWN,
    Shown("inertia", _INERTIA, "Inertia", "kg·m²", 1.0),
    Shown("pose-rotation", _ROTATION, "Poses of the neighbours: rotation", "°", 180.0 / np.pi),
    Shown("pose-translation", _TRANSLATION, "Poses of the neighbours: translation", "mm", 1e3),
)


@dataclass(frozen=True, eq=False)
class Curve:
    """An error over time and how large it may be, in the unit shown, shape (n,) each; NaN while stale.

    Attributes:
        neighbour: Whom it is about; None if about the payload.
        time: Of the estimates [s].
        error: Its size.
        std: Its own standard deviation.
    """

    neighbour: str | None
    time: Array
    error: Array
    std: Array


def curves(series: Series, name: str, shown: Shown) -> list[Curve]:
    """What is to be drawn of a quantity for one robot."""
    neighbours: Sequence[str | None] = [None] if shown.quantity.of_payload else series.scene.neighbours[name]
    points = list(series.robots[name].points)
    times = np.array([point.time for point in points])
    claimed = np.where([point.is_stale for point in points], np.nan, 1.0)
    found = []
    for neighbour in neighbours:
        error, std = sizes(points, shown.quantity, neighbour)
        found.append(Curve(neighbour, times, shown.per_unit * claimed * error, shown.per_unit * claimed * std))
    return found


def inside_band(series: Series, shown: Shown) -> float | None:
    """Share of the moments in which the error was below three own standard deviations; None if there was none."""
    below = np.concatenate(
        [(c.error <= 3.0 * c.std)[np.isfinite(c.error)] for name in series.robots for c in curves(series, name, shown)]
    )
    return float(np.mean(below)) if len(below) else None


def convergence_size(series: Series) -> tuple[float, float]:
    """Width and height of ``draw_convergence`` [inches]."""
    rows, _ = _grid(len(robots_shown(series)))
    return 10.0, 0.9 + 2.0 * rows


def _grid(panels: int) -> tuple[int, int]:
    """Rows and columns."""
    columns = 2 if panels in (2, 4) else 3
    return -(-panels // columns), columns


def draw_convergence(figure: Any, theme: Theme, series: Series, report: Report, shown: Shown) -> None:
    """Errors of a quantity and three times the own standard deviation over time, one panel per robot."""
    names = robots_shown(series)
    rows, columns = _grid(len(names))
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    drawn = {name: curves(series, name, shown) for name in names}
    for axes, name in zip(grid, names, strict=False):
        use_logarithm(axes)
        axes.set_title(name, loc="left", fontweight="bold")
        _shade_stale(axes, theme, series, name)
        mark_changes(axes, theme, report)
        for k, curve in enumerate(drawn[name]):
            label = "error" if curve.neighbour is None else f"of {curve.neighbour}"
            colour = theme.of_curve(k)
            if k == 0:
                axes.fill_between(curve.time, 1e-12, 3.0 * curve.std, color=colour, alpha=0.10, linewidth=0)
            axes.plot(curve.time, 3.0 * curve.std, color=colour, linewidth=0.9, linestyle=(0, (4, 2)))
            axes.plot(curve.time, curve.error, color=colour, label=label)
        if drawn[name] and drawn[name][0].neighbour is not None:
            axes.legend(loc="upper right", ncols=2, handlelength=1.0, borderaxespad=0.0)
        else:
            _tell_end(axes, theme, drawn[name][0], shown.unit)
    for axes in grid[len(names) :]:
        axes.set_visible(False)
    grid[0].set_xlim(0.0, report.duration_s)
    grid[0].set_ylim(*_limits(curve for found in drawn.values() for curve in found))
    for axes in grid[max(0, len(names) - columns) : len(names)]:
        axes.set_xlabel("time [s]")
        axes.tick_params(labelbottom=True)
    figure.supylabel(f"error [{shown.unit}]", fontsize=9, color=theme.ink)


def _limits(drawn: Iterable[Curve]) -> tuple[float, float]:
    """What is worth seeing: errors pass through zero, which has no logarithm."""
    errors, bands = [], []
    for curve in drawn:
        errors.append(curve.error[np.isfinite(curve.error) & (curve.error > 0.0)])
        bands.append(3.0 * curve.std[np.isfinite(curve.std) & (curve.std > 0.0)])
    error, band = np.concatenate([[], *errors]), np.concatenate([[], *bands])
    if not len(error) or not len(band):
        return 0.1, 1.0
    return float(0.02 * band.min()), float(2.0 * max(error.max(), band.max()))


def _tell_end(axes: Any, theme: Theme, curve: Curve, unit: str) -> None:
    if len(curve.error) and np.isfinite(curve.error[-1]):
        text = f"at the end {curve.error[-1]:.2g} {unit}, own std {curve.std[-1]:.2g}"
        axes.set_title(text, loc="right", fontsize=8, color=theme.muted)


def _shade_stale(axes: Any, theme: Theme, series: Series, name: str) -> None:
    for span in series.robots[name].states.spans:
        if span.state is State.STALE:
            axes.axvspan(span.start, span.end, color=theme.warning, alpha=0.18, linewidth=0)
