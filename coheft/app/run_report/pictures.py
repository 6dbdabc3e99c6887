"""Which pictures a report has."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from coheft.app.figures import Theme
from coheft.app.results.report import Report
from coheft.app.run_report.convergence import ALL_SHOWN, convergence_size, draw_convergence, inside_band
from coheft.app.run_report.drawings import (
    close_up_size,
    draw_close_ups,
    draw_consensus,
    draw_observability,
    draw_overview,
    draw_pace,
    observability_size,
)
from coheft.app.run_report.series import Series

PICTURES = (
    "mass-over-time",
    *(shown.name for shown in ALL_SHOWN),
    "load-changes",
    "consensus",
    "observability",
    "pace",
)
"""Names of all pictures that there may be."""

Draw = Callable[[Any, Theme, Series, Report], None]


@dataclass(frozen=True)
class Picture:
    """One picture; ``pictures.html.jinja`` has its title and what is said about it.

    Attributes:
        name: Of its file, without suffix.
        section: Of the page in which it stands.
        size: Width and height [inches].
        draw: Draws it.
        inside: Share of the errors that are inside of their band, of a picture of errors.
    """

    name: str
    section: str
    size: tuple[float, float]
    draw: Draw
    inside: float | None = None


def pictures_of(series: Series, report: Report) -> list[Picture]:
    """The pictures of a run, in their order on the page."""
    pictures = [Picture("mass-over-time", "glance", (10.0, 3.2), draw_overview)]
    for shown in ALL_SHOWN:
        inside = inside_band(series, shown)
        if inside is not None:  # else nothing was claimed, and there is nothing to draw
            draw = partial(draw_convergence, shown=shown)
            pictures.append(Picture(shown.name, "errors", convergence_size(series), draw, inside))
    if series.close_ups:
        pictures.append(Picture("load-changes", "changes", close_up_size(series), draw_close_ups))
    if report.consensus.force_rel_error is not None:
        pictures.append(Picture("consensus", "consensus", (10.0, 3.8), draw_consensus))
    pictures.append(Picture("observability", "observability", observability_size(series), draw_observability))
    if len(series.pace):  # else it is a recording
        pictures.append(Picture("pace", "timing", (10.0, 2.6), draw_pace))
    return pictures
