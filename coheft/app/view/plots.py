"""Plots of a robot's errors over time, with the band of its own standard deviations."""

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
import viser
from viser import uplot

from coheft.app.view.colours import ACCENT, FORCE, TORQUE, css
from coheft.app.view.traces import WINDOW, Curves, Trace
from coheft.estimation.geometry.spatial import Array

_TITLES = {"mass": "mass error, kg", "com": "centre of mass error, mm", "inertia": "inertia error, kg·m²"}
_AXES = {"mass": ("mass",), "com": ("x", "y", "z"), "inertia": ("xx", "yy", "zz")}
_LINES = (ACCENT, FORCE, TORQUE)
_BAND = "rgba(148,163,184,0.18)"
_BAND_EDGE = "rgba(148,163,184,0.55)"
_GRID: uplot.Axis_Grid = {"stroke": "rgba(148,163,184,0.14)", "width": 1}
_INK = "#94a3b8"
_HEIGHT = 105
_BEYOND = 100.0
"""Half width of the band where nothing is known, relative to the limit of the axis."""


class Plots:
    """A plot for each quantity of the chosen robot, and each estimator; those of a quantity are below each other."""

    def __init__(self, server: viser.ViserServer, estimators: Sequence[str]) -> None:
        keys = list(product(_TITLES, estimators))
        self._plots = {
            (name, estimator): _add_plot(server, name, f", {estimator}" if len(estimators) > 1 else "", is_last=last)
            for (name, estimator), last in zip(keys, [*[False] * (len(keys) - 1), True], strict=True)
        }

    def draw(self, traces: Mapping[str, Trace], time: float) -> None:
        """Draw a robot's curves by each estimator; ``time`` is the present [s]."""
        for estimator, trace in traces.items():
            for name, curves in trace.curves().items():
                plot = self._plots[name, estimator]
                plot.data = _data(curves)
                plot.scales = _scales(curves, time)


def _add_plot(server: viser.ViserServer, name: str, of_estimator: str, *, is_last: bool) -> Any:
    nothing = Curves(np.empty(0), np.empty((len(_AXES[name]), 0)), np.empty(0))
    edge: uplot.Series = {"stroke": _BAND_EDGE, "width": 1, "points": {"show": False}}
    lines: list[uplot.Series] = [
        {"label": axis, "width": 0, "points": {"show": True, "size": 2.5, "fill": css(colour), "width": 0}}
        for axis, colour in zip(_AXES[name], _LINES, strict=False)
    ]
    label: uplot.Axis = {"label": "time, s", "labelSize": 14, "labelFont": "11px sans-serif"} if is_last else {}
    axis: uplot.Axis = {"stroke": _INK, "grid": _GRID, "ticks": {"show": False}, "font": "11px sans-serif"}
    return server.gui.add_uplot(
        _data(nothing),
        ({"label": "t"}, {**edge, "label": "+3σ"}, {**edge, "label": "-3σ"}, *lines),
        title=_TITLES[name] + of_estimator,
        bands=({"series": (1, 2), "fill": _BAND, "dir": -1},),
        scales=_scales(nothing, 0.0),
        axes=({**axis, **label, "size": 24}, {**axis, "size": 52, "space": 18}),
        legend={"show": False},
        cursor={"show": False},
        height=_HEIGHT + 14 * is_last,
        padding=(4, 10, 0, 0),
    )


def _data(curves: Curves) -> tuple[Array, ...]:
    """Return the data of a plot: errors as points, since lines would bridge times at which nothing is known.

    At these times the band covers everything.
    """
    band = np.where(np.isfinite(curves.band), curves.band, _BEYOND * curves.limit)
    return curves.times, band, -band, *curves.errors


def _scales(curves: Curves, time: float) -> dict[str, uplot.Scale]:
    end = max(time, WINDOW)
    # Without "time": False the browser would show the run's seconds as a time of day.
    return {
        "x": {"time": False, "range": (end - WINDOW, end)},
        "y": {"range": (-curves.limit, curves.limit)},
    }
