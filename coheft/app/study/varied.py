"""Studies of one scenario with several values of a key, for comparison."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec

from coheft.app.results.quantities import QUANTITIES
from coheft.app.study.report import StudyReport
from coheft.app.study.tables import NAMES, plain, short

COLUMNS = ("value", "estimator", *(f"{NAMES[quantity.name][0]}, {NAMES[quantity.name][1]}" for quantity in QUANTITIES))


class Variant(msgspec.Struct, frozen=True):
    """The study of one value; ``set`` is the key with the value, as for ``--set``."""

    set: str
    study: StudyReport


class VariedReport(msgspec.Struct, frozen=True):
    """Studies that differ in one value of the scenario."""

    variants: list[Variant]


def rows(report: VariedReport) -> Iterator[tuple[str, ...]]:
    """Yield RMS errors at the last time and the first noise, with the ratio to the bound in brackets, see
    ``COLUMNS``.
    """
    for variant in report.variants:
        study = variant.study
        cell = next(c for c in study.cells if (c.noise_scale, c.at_s) == (study.noise_scales[0], study.at_s[-1]))
        for estimator, result in cell.results.items():
            accuracies = [(getattr(result, quantity.name), NAMES[quantity.name][2]) for quantity in QUANTITIES]
            numbers = [f"{plain(each.rms, size)} ({short(each.ratio_full)})" for each, size in accuracies]
            yield variant.set.partition("=")[2], estimator, *numbers
