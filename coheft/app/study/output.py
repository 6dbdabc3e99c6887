"""Output of a study's results to the terminal and to a folder."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import msgspec
import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from coheft.app.figures import figure_to
from coheft.app.results.quantities import QUANTITIES
from coheft.app.results.report import write_report
from coheft.app.study import tables
from coheft.app.study.report import Accuracy, StudyReport
from coheft.app.study.trial import Trial
from coheft.app.terminal.wide_table import print_table
from coheft.errors import CoheftError, file_errors

_WIDTH = 7
"""Number of columns that fit into a terminal."""
_COLOURS = {"fan2017": "#c45a00", "efficient": "#0b62a4"}


class Variant(msgspec.Struct, frozen=True):
    """The study of one value; ``set`` is the key with the value, as for ``--set``."""

    set: str
    study: StudyReport


class VariedReport(msgspec.Struct, frozen=True):
    """Studies that differ in one value of the scenario."""

    variants: list[Variant]


def write_folder(report: StudyReport, trials: Sequence[Trial], folder: Path) -> None:
    """Write ``report.md``, its pictures and ``report.json`` into an existing folder, or raise a ``CoheftError``."""
    pictures = {"Errors over bounds": "ratios.png", "Errors of one run over time": "curves.png"}
    write_report(report, str(folder / "report.json"))
    with file_errors(CoheftError, f"cannot write into {folder}"):
        (folder / "report.md").write_text(tables.markdown(report, pictures), encoding="utf-8")
        _plot_ratios(report, folder / "ratios.png")
        _plot_curves(trials, folder / "curves.png")


def _plot_ratios(report: StudyReport, path: Path) -> None:
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
            axes.set_xticks(range(len(QUANTITIES)), [tables.NAMES[q.name][0].replace(" ", "\n", 1) for q in QUANTITIES])
            axes.set_yscale("log")
            axes.yaxis.set_major_formatter("{x:g}")
            axes.yaxis.set_minor_formatter("{x:g}")
            axes.set_title(tables.caption(cell))
        row[0].legend()
        figure.supylabel("RMS error / bound")


def _plot_curves(trials: Sequence[Trial], path: Path) -> None:
    """Plot errors of the first run's first robot over time, and three times its own standard deviation."""
    outcomes = trials[0].outcomes
    with figure_to(path, 4.5 * len(outcomes), 9.0) as figure:
        grid = figure.subplots(len(QUANTITIES), len(outcomes), sharex=True, sharey="row", squeeze=False)
        for column, (estimator, outcome) in zip(grid.T, outcomes.items(), strict=True):
            curves, colour = outcome.curves, _COLOURS.get(estimator)
            for k, (axes, quantity) in enumerate(zip(column, QUANTITIES, strict=True)):
                name, unit, size = tables.NAMES[quantity.name]
                axes.semilogy(curves.times, size * curves.errors[:, k], color=colour, label="error")
                axes.semilogy(
                    curves.times, 3.0 * size * curves.deviations[:, k], "--", color="grey", label="own 3 sigma"
                )
                axes.set_ylabel(f"{name}\n[{unit}]")
                axes.label_outer()
            column[0].set_title(f"{estimator}, seed {trials[0].seed}")
            column[0].legend()
            column[-1].set_xlabel("time [s]")


def print_study(console: Console, report: StudyReport) -> None:
    """Print a study."""
    console.print(f"{tables.title(report)}\n")
    for part in tables.parts(report):
        if isinstance(part, tables.Part):
            print_table(console, _table(part.title, part.header[:_WIDTH], part.rows))
        else:
            for line in part:
                console.print(line, highlight=False)
        console.print()
    for line in tables.LEGEND:
        console.print(line, style="dim", highlight=False)


def print_varied(console: Console, report: VariedReport) -> None:
    """Print studies of several values of a key in one table."""
    study, key = report.variants[0].study, report.variants[0].set.partition("=")[0]
    console.print(f"{tables.title(study)}\n")
    columns = ("value", "estimator", *(f"{name}, {unit}" for name, unit, _ in tables.NAMES.values()))
    words = f"RMS errors (times the bound) by {key}, noise × {study.noise_scales[0]:g}, at {study.at_s[-1]:g} s"
    print_table(console, _table(words, columns, _varied_rows(report)))


def _varied_rows(report: VariedReport) -> Iterator[tuple[str, ...]]:
    """Yield RMS errors at the last time and the first noise, with the ratio to the bound in brackets."""
    for variant in report.variants:
        study = variant.study
        cell = next(c for c in study.cells if (c.noise_scale, c.at_s) == (study.noise_scales[0], study.at_s[-1]))
        for estimator, result in cell.results.items():
            accuracies = [(getattr(result, name), size) for name, (_, _, size) in tables.NAMES.items()]
            numbers = [f"{tables.plain(each.rms, size)} ({tables.short(each.ratio_full)})" for each, size in accuracies]
            yield variant.set.partition("=")[2], estimator, *numbers


def _table(words: str, header: Sequence[str], rows: Iterable[tuple[str, ...]]) -> Table:
    table = Table(title=words, title_justify="left", box=SIMPLE_HEAD, pad_edge=False, show_edge=False, padding=0)
    for k, name in enumerate(header):
        table.add_column(name, justify="left" if k < 2 else "right", no_wrap=True)
    previous = ""
    for row in rows:
        table.add_row("" if row[0] == previous else row[0], *row[1 : len(header)])
        previous = row[0]
    return table
