"""Errors over time, with three times the robot's own standard deviation."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from coheft.app.figures import Theme
from coheft.app.results.points import sizes
from coheft.app.results.quantities import QUANTITIES, Quantity
from coheft.app.results.report import Report
from coheft.app.results.states import State
from coheft.app.run_report.series import Series
from coheft.app.terminal.digits import significant
from coheft.estimation.geometry.spatial import Array


@dataclass(frozen=True)
class Shown:
    """How a quantity is shown: name of its picture, unit, and number of these units in one of the quantity's own."""

    name: str
    quantity: Quantity
    unit: str
    per_unit: float


_MOST_CHANGES = 50
_ROTATION, _TRANSLATION, _MASS, _COM, _INERTIA = QUANTITIES
COM_SHOWN = Shown("centre-of-mass", _COM, "mm", 1e3)
ALL_SHOWN = (
    Shown("mass", _MASS, "g", 1e3),
    COM_SHOWN,
    Shown("inertia", _INERTIA, "kg·m²", 1.0),
    Shown("pose-rotation", _ROTATION, "°", 180.0 / np.pi),
    Shown("pose-translation", _TRANSLATION, "mm", 1e3),
)


@dataclass(frozen=True, eq=False)
class Curve:
    """An error and its own standard deviation over time, in the unit shown, shape (n,) each; NaN while stale.

    Attributes:
        neighbour: The neighbour whose pose it is of; None for the payload.
        std: The robot's own standard deviations of these.
    """

    neighbour: str | None
    time: Array
    error: Array
    std: Array


def curves(series: Series, name: str, shown: Shown, estimator: str | None = None) -> list[Curve]:
    """Return the curves of a quantity for one robot, by an estimator; None stands for the robots' own."""
    robots = series.by_estimator[estimator or series.estimator]
    neighbours: Sequence[str | None] = [None] if shown.quantity.of_payload else series.scene.neighbours[name]
    points = list(robots[name].points)
    times = np.array([point.time for point in points])
    claimed = np.where([point.is_stale for point in points], np.nan, 1.0)
    found = []
    for neighbour in neighbours:
        error, std = sizes(points, shown.quantity, neighbour)
        found.append(Curve(neighbour, times, shown.per_unit * claimed * error, shown.per_unit * claimed * std))
    return found


def inside_band(series: Series, shown: Shown) -> float | None:
    """Return the share of errors that are below three own standard deviations; None if there are no errors."""
    below = np.concatenate(
        [(c.error <= 3.0 * c.std)[np.isfinite(c.error)] for name in series.robots for c in curves(series, name, shown)]
    )
    return float(np.mean(below)) if len(below) else None


def use_logarithm(axes: Any) -> None:
    """Use a logarithmic scale with powers of ten that are written out."""
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.minorticks_off()


def mark_changes(axes: Any, theme: Theme, report: Report) -> None:
    """Draw dotted lines where the load changed."""
    for change in report.load_changes[:_MOST_CHANGES]:
        axes.axvline(change.at_s, color=theme.muted, linewidth=0.9, linestyle=":")


def grid_of(panels: int) -> tuple[int, int]:
    """Return the rows and columns of a grid of panels."""
    columns = 2 if panels in (2, 4) else 3
    return -(-panels // columns), columns


def draw_convergence(figure: Any, theme: Theme, series: Series, report: Report, shown: Shown) -> None:
    """Draw errors of a quantity and three times the own standard deviation over time, one panel per robot.

    Of the payload, those of estimators that ran beside the robots' own are drawn in other colours.
    """
    names = series.drawn
    rows, columns = grid_of(len(names))
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    drawn: list[Curve] = []
    for axes, name in zip(grid, names, strict=False):
        own = curves(series, name, shown)
        estimators = series.beside if shown.quantity.of_payload else []
        others = {other: curves(series, name, shown, other)[0] for other in estimators}
        drawn += [*own, *others.values()]
        use_logarithm(axes)
        axes.set_title(name, loc="left", fontweight="bold")
        for span in series.robots[name].spans:
            if span.state is State.STALE:
                axes.axvspan(span.start, span.end, color=theme.warning, alpha=0.18, linewidth=0)
        mark_changes(axes, theme, report)
        for k, curve in enumerate(own):
            label = series.estimator if curve.neighbour is None else f"of {curve.neighbour}"
            colour = theme.of_curve(k)
            if k == 0:
                axes.fill_between(curve.time, 1e-12, 3.0 * curve.std, color=colour, alpha=0.10, linewidth=0)
            axes.plot(curve.time, 3.0 * curve.std, color=colour, linewidth=0.9, linestyle=(0, (4, 2)))
            axes.plot(curve.time, curve.error, color=colour, label=label)
        for k, (other, curve) in enumerate(others.items(), start=1):
            style = {"color": theme.of_curve(k), "linewidth": 1.0}
            axes.plot(curve.time, 3.0 * curve.std, linestyle=(0, (4, 2)), **style)
            axes.plot(curve.time, curve.error, label=other, **style)
        first = own[0]
        if first.neighbour is not None or others:
            axes.legend(loc="upper right", ncols=2, handlelength=1.0, borderaxespad=0.0)
        elif len(first.error) and np.isfinite(first.error[-1]):
            text = f"at the end {significant(first.error[-1], 2)} {shown.unit}, own std {significant(first.std[-1], 2)}"
            axes.set_title(text, loc="right", fontsize=8, color=theme.muted)
    for axes in grid[len(names) :]:
        axes.set_visible(False)
    grid[0].set_xlim(0.0, report.duration_s)
    grid[0].set_ylim(*_limits(drawn))
    for axes in grid[max(0, len(names) - columns) : len(names)]:
        axes.set_xlabel("time [s]")
        axes.tick_params(labelbottom=True)
    figure.supylabel(f"error [{shown.unit}]", fontsize=9, color=theme.ink)


def _limits(drawn: Iterable[Curve]) -> tuple[float, float]:
    """Return the limits of the axis of errors, which pass through zero: that has no logarithm."""
    errors, bands = [], []
    for curve in drawn:
        errors.append(curve.error[np.isfinite(curve.error) & (curve.error > 0.0)])
        bands.append(3.0 * curve.std[np.isfinite(curve.std) & (curve.std > 0.0)])
    error, band = np.concatenate([[], *errors]), np.concatenate([[], *bands])
    if not len(error) or not len(band):
        return 0.1, 1.0
    return float(0.02 * band.min()), float(2.0 * max(error.max(), band.max()))
