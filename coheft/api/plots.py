"""Plots of a result."""

from typing import Any

import numpy as np

from coheft.api.result import Result
from coheft.app.figures import LIGHT, settings_of
from coheft.errors import MissingPackageError
from coheft.estimation.geometry.spatial import Array

_SIZE = (8.0, 7.0)
_BAND = 3.0
"""Own standard deviations of the bands."""


def plot_result(result: Result) -> Any:
    """See ``Result.plot``."""
    try:
        from matplotlib import pyplot, rc_context
    except ImportError as error:
        raise MissingPackageError("matplotlib", "study") from error
    # Made outside of the context, which would undo settings of a notebook's backend when that is loaded.
    figure = pyplot.figure(figsize=_SIZE, layout="constrained", facecolor=LIGHT.paper)
    with rc_context(settings_of(LIGHT)):
        axes = figure.subplots(3, 1, sharex=True)
        for number, (name, robot) in enumerate(result.robots.items()):
            colour = LIGHT.of_curve(number)
            if number == 0:
                axes[0].plot(robot.time, robot.mass.truth, color=LIGHT.ink, linewidth=3, alpha=0.35, label="truth")
            band = _BAND * robot.mass.std
            low, high = robot.mass.estimate - band, robot.mass.estimate + band
            axes[0].fill_between(robot.time, low, high, color=colour, alpha=0.12, linewidth=0)
            axes[0].plot(robot.time, robot.mass.estimate, color=colour, label=name)
            for panel, track, unit in ((axes[1], robot.com, 1e3), (axes[2], robot.inertia, 1.0)):
                panel.plot(robot.time, unit * _length(track.error), color=colour)
                panel.plot(robot.time, _BAND * unit * _length(track.std), color=colour, linewidth=0.8, linestyle="--")
        masses = np.concatenate([robot.mass.truth for robot in result.robots.values()])
        if len(masses):  # the first estimates may be far off, and would determine the scale
            axes[0].set_ylim(0.8 * masses.min(), 1.2 * masses.max())
        axes[0].set_ylabel("mass [kg]")
        axes[1].set_ylabel("error of centre\nof mass [mm]")
        axes[2].set_ylabel("error of inertia\n[kg·m²]")
        axes[2].set_xlabel(f"time [s]; dashed and shaded: {_BAND:g} of the robots' own standard deviations")
        for panel in axes[1:]:
            panel.set_yscale("log")
        for panel in axes:
            for change in result.load_changes:
                panel.axvline(change.at_s, color=LIGHT.muted, linestyle=":", linewidth=1)
        axes[0].set_title(f"{result.scenario.name}, {result.report.estimator}", loc="left")
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=9)
    return axes


def _length(values: Array) -> Array:
    """Euclidean or Frobenius norm of each moment's numbers, shape (n, ...) to (n,)."""
    flat = values.reshape(len(values), -1 if len(values) else 1)
    lengths: Array = np.sqrt(np.square(flat).sum(axis=1))
    return lengths
