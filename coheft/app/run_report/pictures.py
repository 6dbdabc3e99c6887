"""Which pictures a report has, what they are called, and what is said about them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from coheft.app.figures import Theme
from coheft.app.results.report import Report
from coheft.app.run_report.convergence import ALL_SHOWN, Shown, convergence_size, draw_convergence, inside_band
from coheft.app.run_report.drawings import (
    close_up_size,
    draw_close_ups,
    draw_consensus,
    draw_observability,
    draw_overview,
    draw_pace,
    observability_size,
)
from coheft.app.run_report.panels import MOST_ROBOTS
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
    """One picture.

    Attributes:
        name: Of its file, without suffix.
        section: Of the page in which it stands.
        title: Above it.
        text: Below it, for somebody who has not read the papers.
        size: Width and height [inches].
        draw: Draws it.
    """

    name: str
    section: str
    title: str
    text: str
    size: tuple[float, float]
    draw: Draw


def pictures_of(series: Series, report: Report) -> list[Picture]:
    """The pictures of a run, in their order on the page."""
    some = f" Shown are {MOST_ROBOTS} of the {len(series.robots)} robots." if len(series.robots) > MOST_ROBOTS else ""
    pictures = [
        Picture(
            "mass-over-time",
            "glance",
            "The mass that each robot believes in",
            "Grey: what the load really weighs. Coloured: what each robot takes it for, and around it the band of "
            "three of its own standard deviations, often too narrow to be seen. Thin and dotted: stale, no one should "
            f"rely on it. Upright, dotted: the load changed.{some}",
            (10.0, 3.2),
            draw_overview,
        )
    ]
    for shown in ALL_SHOWN:
        share = inside_band(series, shown)
        if share is not None:  # else nothing was claimed, and there is nothing to draw
            text = f"{_ERRORS[shown.name]} The error was inside the band in {100.0 * share:.1f} % of all valid reports."
            draw = partial(_draw_errors, shown=shown)
            pictures.append(Picture(shown.name, "errors", shown.title, text + some, convergence_size(series), draw))
    if series.close_ups:
        pictures.append(
            Picture(
                "load-changes",
                "changes",
                "The load changes, close up",
                "Left: the mass that each robot believes in, and the truth in grey. Right: by how far the centre of "
                "mass is off, and dashed three own standard deviations. Every dot is a report. Orange: when the "
                "last robot had noticed that the load is another one, and when all were near the truth again. Between "
                "the two they call their estimate stale, on the left thin and dotted: the old one no longer holds, and "
                "there is no new one yet." + some,
                close_up_size(series),
                draw_close_ups,
            )
        )
    if report.consensus.force_rel_error is not None:
        pictures.append(
            Picture(
                "consensus",
                "consensus",
                "What each robot takes the total for, minus the measured total",
                "All robots together push on the load with one total force and torque. Each robot measures its own "
                "share only; it learns the total from what its neighbours pass on. Grey: the size of the total itself, "
                "from everyone's sensors and true positions. Coloured: how far each robot is from it. The torque "
                "counts about the robot's own grasp, so it is another one for each. The scale is logarithmic." + some,
                (10.0, 3.8),
                draw_consensus,
            )
        )
    pictures.append(
        Picture(
            "observability",
            "observability",
            "What each robot could tell, and when",
            "Motion is what shows a robot where its neighbours are and what the load is like: without a turn about an "
            "axis, nothing can be said about the inertia around it. A robot does not guess: it says what it cannot "
            f"tell yet, and calls an estimate stale when it cannot know whether it still holds.{some}",
            observability_size(series),
            draw_observability,
        )
    )
    if len(series.pace):  # else it is a recording
        pictures.append(
            Picture(
                "pace",
                "timing",
                "How fast the simulation went",
                "Simulated seconds per second on the wall; above the dotted line the run is faster than the real "
                "thing. Dashed: the average that the server reports, which leaves pauses out.",
                (10.0, 2.6),
                draw_pace,
            )
        )
    return pictures


def _draw_errors(figure: Any, theme: Theme, series: Series, report: Report, *, shown: Shown) -> None:
    draw_convergence(figure, theme, series, report, shown)


_ERRORS = {
    "mass": "What the load weighs.",
    "centre-of-mass": "The distance between the centre of mass and where the robot believes it to be.",
    "inertia": "How hard the load is to turn: the size of the difference between the two inertia matrices.",
    "pose-rotation": "How each neighbour's hand is turned against one's own; one colour for each neighbour.",
    "pose-translation": "How far away each neighbour's hand is, and where; one colour for each neighbour.",
}
