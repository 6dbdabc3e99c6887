"""What the report's pictures share: the robots that are shown, and marks."""

from typing import Any

import numpy as np

from coheft.app.figures import Theme
from coheft.app.results.report import Report
from coheft.app.run_report.series import Series

MOST_ROBOTS = 24
"""Largest number of robots that are drawn."""
_MOST_CHANGES = 50


def robots_shown(series: Series) -> list[str]:
    """Return the robots that are drawn: all, or evenly spread ones of many."""
    names = list(series.robots)
    if len(names) <= MOST_ROBOTS:
        return names
    return [names[k] for k in np.linspace(0, len(names) - 1, MOST_ROBOTS).round().astype(int)]


def use_logarithm(axes: Any) -> None:
    """Use a logarithmic scale with powers of ten that are written out."""
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.minorticks_off()


def mark_changes(axes: Any, theme: Theme, report: Report) -> None:
    """Draw dotted lines where the load changed."""
    for change in report.load_changes[:_MOST_CHANGES]:
        axes.axvline(change.at_s, color=theme.muted, linewidth=0.9, linestyle=":")
