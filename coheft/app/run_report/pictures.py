"""The pictures of a report."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from coheft.app.figures import Theme
from coheft.app.results.report import Report
from coheft.app.run_report import drawings
from coheft.app.run_report.convergence import ALL_SHOWN, draw_convergence, grid_of, inside_band
from coheft.app.run_report.panels import robots_shown
from coheft.app.run_report.series import Series


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
    robots = len(robots_shown(series))
    pictures = [Picture("mass-over-time", "glance", 0.6 + 2.6 * len(series.by_estimator), drawings.draw_overview)]
    for shown in ALL_SHOWN:
        inside = inside_band(series, shown)
        if inside is not None:  # else nothing was claimed, and there is nothing to draw
            height, draw = 0.9 + 2.0 * grid_of(robots)[0], partial(draw_convergence, shown=shown)
            pictures.append(Picture(shown.name, "errors", height, draw, inside))
    if series.close_ups:
        height = 0.6 + 2.9 * len(series.close_ups)
        pictures.append(Picture("load-changes", "changes", height, drawings.draw_close_ups))
    if report.consensus.force_rel_error is not None:
        pictures.append(Picture("consensus", "consensus", 3.8, drawings.draw_consensus))
    height = 1.8 + 0.28 * robots
    pictures.append(Picture("observability", "observability", height, drawings.draw_observability))
    if list(series.pace):  # else it is a recording
        pictures.append(Picture("pace", "timing", 2.6, drawings.draw_pace))
    return pictures
