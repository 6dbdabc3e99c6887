"""The pictures of a report; ``convergence`` draws the errors over time."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from coheft.app.figures import Theme
from coheft.app.results.points import Point, sizes
from coheft.app.results.report import Report
from coheft.app.results.states import MEANINGS, State
from coheft.app.run_report.convergence import (
    ALL_SHOWN,
    COM_SHOWN,
    draw_convergence,
    grid_of,
    inside_band,
    mark_changes,
    use_logarithm,
)
from coheft.app.run_report.series import AFTER, BEFORE, Series
from coheft.estimation.geometry.spatial import Array

STALE_STYLE: dict[str, Any] = {"linestyle": (0, (1, 2)), "linewidth": 0.8, "label": "stale"}
"""Style of lines where a robot could not know whether its estimate still held."""


@dataclass(frozen=True)
class Picture:
    """One picture, ten inches wide; ``pictures.html.jinja`` has its title and text, by the name, which is also its
    file's.

    Of a picture of errors, ``inside`` is the share of them that are inside of their band.
    """

    name: str
    section: str
    height: float
    draw: Callable[[Any, Theme, Series, Report], None]
    inside: float | None = None


def pictures_of(series: Series, report: Report) -> list[Picture]:
    """Return the pictures of a run, in their order on the page."""
    robots = len(series.drawn)
    pictures = [Picture("mass-over-time", "glance", 0.6 + 2.6 * len(series.by_estimator), draw_overview)]
    for shown in ALL_SHOWN:
        inside = inside_band(series, shown)
        if inside is not None:  # else nothing was claimed, and there is nothing to draw
            height, draw = 0.9 + 2.0 * grid_of(robots)[0], partial(draw_convergence, shown=shown)
            pictures.append(Picture(shown.name, "errors", height, draw, inside))
    if series.close_ups:
        height = 0.6 + 2.9 * len(series.close_ups)
        pictures.append(Picture("load-changes", "changes", height, draw_close_ups))
    if report.consensus.force_rel_error is not None:
        pictures.append(Picture("consensus", "consensus", 3.8, draw_consensus))
    height = 1.8 + 0.28 * robots
    pictures.append(Picture("observability", "observability", height, draw_observability))
    if list(series.pace):  # else it is a recording
        pictures.append(Picture("pace", "timing", 2.6, draw_pace))
    return pictures


def draw_overview(figure: Any, theme: Theme, series: Series, report: Report) -> None:
    """Draw each robot's estimate of the mass, and the truth; a panel for each estimator."""
    grid = figure.subplots(len(series.by_estimator), 1, sharex=True, squeeze=False).ravel()
    for axes, (estimator, robots) in zip(grid, series.by_estimator.items(), strict=True):
        _draw_overview_of(axes, theme, {name: list(robots[name].points) for name in series.drawn})
        mark_changes(axes, theme, report)
        axes.set_ylabel("mass [kg]")
        if series.beside:
            axes.set_title(estimator, loc="left", fontweight="bold")
    grid[0].set_xlim(0.0, report.duration_s)
    grid[-1].set_xlabel("time [s]")
    figure.legend(*grid[0].get_legend_handles_labels(), loc="outside lower center", ncols=13, handlelength=1.2)


def _draw_overview_of(axes: Any, theme: Theme, robots: Mapping[str, Sequence[Point]]) -> None:
    points = next(iter(robots.values()))
    axes.plot(
        [p.time for p in points],
        [p.truth[0] for p in points],
        color=theme.ink,
        linewidth=3.0,
        alpha=0.4,
        drawstyle="steps-pre",
        label="truth",
    )
    for k, (name, found) in enumerate(robots.items()):
        times = np.array([point.time for point in found])
        mass, std, _, _ = _mass_and_com(found)
        axes.fill_between(times, mass - 3.0 * std, mass + 3.0 * std, color=theme.of_curve(k), alpha=0.12, linewidth=0)
        style = {"color": theme.of_curve(k), "linewidth": 1.1, "label": None if len(robots) > 12 else name}
        _draw_masses(axes, found, times, mass, style)
    _name_stale(axes, theme, robots.values())
    _fit_masses(axes, np.array([p.truth[0] for p in points]), robots.values())


def draw_close_ups(figure: Any, theme: Theme, series: Series, report: Report) -> None:
    """Draw mass and centre of mass around each change of the load, all robots in one panel."""
    names = series.drawn
    grid = figure.subplots(len(series.close_ups), 2, sharex=True, squeeze=False)
    for (left, right), close_up in zip(grid, series.close_ups, strict=True):
        change = next((c for c in report.load_changes if abs(c.at_s - close_up.at) < 1e-6), None)
        times, masses = np.array(close_up.masses).T
        left.plot(times - close_up.at, masses, color=theme.ink, linewidth=2.2, alpha=0.55, label="truth")
        for k, name in enumerate(names):
            points = close_up.points[name]
            when = np.array([point.time for point in points]) - close_up.at
            mass, std, off, band = _mass_and_com(points)
            colour = theme.of_curve(k)
            left.fill_between(when, mass - 3.0 * std, mass + 3.0 * std, color=colour, alpha=0.10, linewidth=0)
            _draw_masses(
                left, points, when, mass, {"color": colour, "marker": "o", "markersize": 2.2, "linewidth": 1.0}
            )
            right.plot(when, band, color=colour, linewidth=0.8, linestyle=(0, (4, 2)))
            right.plot(when, off, color=colour, marker="o", markersize=2.2, linewidth=1.0, label=name)
        _name_stale(left, theme, [close_up.points[name] for name in names])
        _fit_masses(left, masses, close_up.points.values())
        use_logarithm(right)
        moments = {} if change is None else {"noticed": change.detected_at_s, "recovered": change.recovered_at_s}
        for what, moment in moments.items():
            if moment is not None and moment - close_up.at <= AFTER:
                _mark_moment(left, theme, moment - close_up.at, what)
                _mark_moment(right, theme, moment - close_up.at, "")
        for axes in (left, right):
            axes.axvline(0.0, color=theme.muted, linewidth=0.9, linestyle=":")
        left.set_ylabel("mass [kg]")
        right.set_ylabel("centre of mass, error [mm]")
        left.set_title(f"load change at {close_up.at:g} s", loc="left", fontweight="bold")
        left.legend(loc="lower right")
    if len(names) <= 12:
        grid[0][1].legend(loc="upper right", ncols=3, handlelength=1.0)
    grid[0][0].set_xlim(-BEFORE, AFTER)
    for axes in grid[-1]:
        axes.set_xlabel("time since the change [s]")


def _draw_masses(axes: Any, points: Sequence[Point], times: Array, masses: Array, style: dict[str, Any]) -> None:
    """Draw one robot's estimates: solid, but dotted where they were stale.

    An estimate is for the time since the one before it.
    """
    stale = np.array([point.is_stale for point in points], dtype=bool)
    for chosen, more in ((~stale, {}), (stale, {**STALE_STYLE, "label": None})):
        reached = chosen | np.append(chosen[1:], False)
        axes.plot(times, np.where(reached, masses, np.nan), **{**style, **more})


def _name_stale(axes: Any, theme: Theme, robots: Iterable[Sequence[Point]]) -> None:
    """Add dotted lines to the legend, if there are any."""
    if any(point.is_stale for points in robots for point in points):
        axes.plot([], [], color=theme.muted, **STALE_STYLE)


def _mark_moment(axes: Any, theme: Theme, moment: float, text: str) -> None:
    axes.axvline(moment, color=theme.warning, linewidth=0.9, linestyle=(0, (1, 1)))
    style = {"rotation": 90, "va": "center", "fontsize": 8, "color": theme.warning}
    axes.annotate(text, (moment, 0.5), (2, 0), axes.get_xaxis_transform(), "offset points", **style)


def _mass_and_com(points: Sequence[Point]) -> tuple[Array, Array, Array, Array]:
    """Return masses and their std [kg], errors of the centre of mass and three times their std [mm]."""
    mass = np.array([point.truth[0] - point.error[0] for point in points])
    std = np.array([point.std[0] for point in points])
    off, expected = sizes(points, COM_SHOWN.quantity)
    return mass, std, COM_SHOWN.per_unit * off, 3.0 * COM_SHOWN.per_unit * expected


def _fit_masses(axes: Any, masses: Array, robots: Iterable[Sequence[Point]]) -> None:
    """Limit the axis to the estimates: their bands may be many times as wide."""
    found = [point.truth[0] - point.error[0] for points in robots for point in points]
    values = np.concatenate([masses, np.array(found)[np.isfinite(found)]])
    margin = max(0.15 * float(np.ptp(values)), 0.02 * float(values.max()))
    axes.set_ylim(values.min() - margin, values.max() + margin)


def draw_consensus(figure: Any, theme: Theme, series: Series, report: Report) -> None:
    """Draw the difference between each robot's total wrench and the true one, and the total itself."""
    grid = figure.subplots(1, 2, sharex=True)
    names = series.drawn
    for axes, title, part, unit in zip(
        grid, ("force", "torque"), (slice(0, 3), slice(3, 6)), ("N", "N·m"), strict=True
    ):
        for k, name in enumerate(names):
            points = list(series.robots[name].points)
            times = [point.time for point in points]
            totals, residuals = (
                np.linalg.norm(np.array(arrays).reshape(-1, 6)[:, part], axis=1)
                for arrays in ([p.total for p in points], [p.residual for p in points])
            )
            axes.plot(
                times, totals, color=theme.ink, linewidth=0.7, alpha=0.35, label=None if k else "the total itself"
            )
            label = None if len(names) > 8 else name
            axes.plot(times, residuals, color=theme.of_curve(k), linewidth=0.9, alpha=0.85, label=label)
        use_logarithm(axes)
        axes.set_title(title, loc="left", fontweight="bold")
        axes.set_ylabel(f"[{unit}]")
        axes.set_xlabel("time [s]")
        axes.set_xlim(0.0, report.duration_s)
        mark_changes(axes, theme, report)
    figure.legend(*grid[0].get_legend_handles_labels(), loc="outside lower center", ncols=9, handlelength=1.2)


def draw_observability(figure: Any, theme: Theme, series: Series, report: Report) -> None:
    """Draw each robot's states over time."""
    axes = figure.subplots()
    names = series.drawn
    styles = state_styles(theme)
    used: dict[State, Any] = {}
    for row, name in enumerate(names):
        for span in series.robots[name].spans:
            bar = axes.barh(row, span.end - span.start, 0.72, span.start, linewidth=0, **styles[span.state])
            used.setdefault(span.state, bar)
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_xlim(0.0, report.duration_s)
    axes.grid(axis="y", visible=False)
    axes.tick_params(axis="y", length=0, labelcolor=theme.ink)
    axes.spines["left"].set_visible(False)
    axes.set_xlabel("time [s]")
    mark_changes(axes, theme, report)
    states = [state for state in State if state in used]
    figure.legend(
        [used[state] for state in states],
        [f"{state}: {MEANINGS[state]}" for state in states],
        loc="outside upper left",
        ncols=2,
        handlelength=1.2,
        handleheight=1.0,
    )


def state_styles(theme: Theme) -> dict[State, dict[str, Any]]:
    """Return the styles of bars of each state: the darker, the more is known."""
    return {
        State.STALE: {"color": theme.warning, "alpha": 1.0},
        State.FINDING_NEIGHBOURS: {"color": theme.muted, "alpha": 0.25},
        State.WEIGHING: {"color": theme.muted, "alpha": 0.55},
        State.MASS_KNOWN: {"color": theme.accent, "alpha": 0.2},
        State.CENTRE_KNOWN: {"color": theme.accent, "alpha": 0.38},
        State.ALL_KNOWN: {"color": theme.accent, "alpha": 0.6},
        State.CONVERGED: {"color": theme.accent, "alpha": 1.0},
    }


def draw_pace(figure: Any, theme: Theme, series: Series, report: Report) -> None:
    """Draw simulated seconds per second of wall-clock time, over the run."""
    axes = figure.subplots()
    times, walls = np.array(list(series.pace)).reshape(-1, 2).T
    moments = np.arange(walls[0], walls[-1], max(0.5, (walls[-1] - walls[0]) / 200.0))
    simulated = np.interp(moments, walls, times)
    if len(moments) > 1:
        rate = np.diff(simulated) / np.diff(moments)
        axes.step(moments[1:] - walls[0], rate, where="pre", color=theme.accent)
        axes.fill_between(moments[1:] - walls[0], 0.0, rate, step="pre", color=theme.accent, alpha=0.12, linewidth=0)
    axes.axhline(1.0, color=theme.muted, linewidth=0.9, linestyle=":")
    axes.text(1.0, 1.0, " real time", transform=axes.get_yaxis_transform(), fontsize=8, color=theme.muted, va="center")
    axes.axhline(report.real_time_factor, color=theme.warning, linewidth=0.9, linestyle=(0, (4, 2)))
    axes.set_ylim(bottom=0.0)
    axes.set_xlim(left=0.0)
    axes.set_xlabel("time on the wall since the start [s]")
    axes.set_ylabel("simulated seconds per second")
