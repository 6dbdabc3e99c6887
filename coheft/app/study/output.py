"""Output of a study's results to the terminal and to a folder."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import msgspec
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from coheft.app.results.report import write_report
from coheft.app.study import tables
from coheft.app.study.plots import plot_curves, plot_ratios
from coheft.app.study.report import StudyReport
from coheft.app.study.trial import Trial
from coheft.app.terminal.wide_table import print_table
from coheft.errors import CoheftError, file_errors

_WIDTH = 7
"""Number of columns that fit into a terminal."""


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
        plot_ratios(report, folder / "ratios.png")
        plot_curves(trials, folder / "curves.png")


def print_study(console: Console, report: StudyReport) -> None:
    """Print a study."""
    console.print(f"{tables.title(report)}\n")
    for cell in report.cells:
        print_table(console, _table(tables.caption(cell), tables.HEADER[:_WIDTH], tables.accuracy_rows(cell)))
        console.print()
    if len(report.cells) > 1:
        for line in tables.together(report):
            console.print(line, highlight=False)
        console.print()
    recovery = list(tables.recovery_rows(report.results))
    if recovery:
        words = f"{tables.seconds_after(report):g} s after the load change"
        print_table(console, _table(words, tables.RECOVERY_HEADER, recovery))
        console.print()
    for name, result in report.results.items():
        for line in tables.sentences(name, result):
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
