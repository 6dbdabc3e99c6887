"""Pictures of a study."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from coheft.app.figures import figure_to
from coheft.app.results.quantities import QUANTITIES
from coheft.app.study.report import Accuracy, StudyReport
from coheft.app.study.tables import NAMES, caption
from coheft.app.study.trial import Trial

_COLOURS = {"fan2017": "#c45a00", "efficient": "#0b62a4"}


def plot_ratios(report: StudyReport, path: Path) -> None:
    """Plot errors divided by bounds with their sampling intervals, for every noise and time."""
    with figure_to(path, 1.0 + 5.0 * len(report.cells), 3.6) as figure:
        row = np.atleast_1d(figure.subplots(1, len(report.cells), sharey=True))
        for axes, cell in zip(row, report.cells, strict=True):
            for k, (estimator, result) in enumerate(cell.results.items()):
                found: list[Accuracy] = [getattr(result, quantity.name) for quantity in QUANTITIES]
                ratios = np.array(
                    [(a.ratio_full, a.ratio_full_low, a.ratio_full_high) for a in found], dtype=np.float64
                )
                places = np.arange(len(found)) + 0.2 * (k - 0.5 * (len(cell.results) - 1))
                reach = np.abs(ratios[:, 1:] - ratios[:, :1]).T
                style = {"fmt": "o", "capsize": 4, "color": _COLOURS.get(estimator)}
                axes.errorbar(places, ratios[:, 0], reach, label=estimator, **style)
            axes.axhline(1.0, color="black", linewidth=1, linestyle="--")
            axes.set_xticks(range(len(QUANTITIES)), [NAMES[q.name][0].replace(" ", "\n", 1) for q in QUANTITIES])
            axes.set_yscale("log")
            axes.yaxis.set_major_formatter("{x:g}")
            axes.yaxis.set_minor_formatter("{x:g}")
            axes.set_title(caption(cell))
        row[0].legend()
        figure.supylabel("RMS error / bound")


def plot_curves(trials: Sequence[Trial], path: Path) -> None:
    """Plot errors of the first run's first robot over time, and three times its own standard deviation."""
    outcomes = trials[0].outcomes
    with figure_to(path, 4.5 * len(outcomes), 9.0) as figure:
        grid = figure.subplots(len(QUANTITIES), len(outcomes), sharex=True, sharey="row", squeeze=False)
        for column, (estimator, outcome) in zip(grid.T, outcomes.items(), strict=True):
            curves, colour = outcome.curves, _COLOURS.get(estimator)
            for k, (axes, quantity) in enumerate(zip(column, QUANTITIES, strict=True)):
                name, unit, size = NAMES[quantity.name]
                axes.semilogy(curves.times, size * curves.errors[:, k], color=colour, label="error")
                axes.semilogy(
                    curves.times, 3.0 * size * curves.deviations[:, k], "--", color="grey", label="own 3 sigma"
                )
                axes.set_ylabel(f"{name}\n[{unit}]")
                axes.label_outer()
            column[0].set_title(f"{estimator}, seed {trials[0].seed}")
            column[0].legend()
            column[-1].set_xlabel("time [s]")
