"""The report as one HTML page that needs no other file."""

import base64
from collections.abc import Iterable, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import msgspec
from msgspec import structs

from coheft.app.results.judge import Verdict
from coheft.app.results.record import load_ids
from coheft.app.results.report import Report
from coheft.app.results.states import State
from coheft.app.run_report.data import TABLES
from coheft.app.run_report.drawings import Picture
from coheft.app.run_report.series import MOST_ROBOTS, Series, Span
from coheft.app.terminal.final_table import TEXT_HEADINGS, headings, legend, sentences, table_rows
from coheft.app.versions import versions
from coheft.estimation.geometry.spatial import Array
from coheft.wire.messages.truth import Truth
from coheft.wire.scenario.schema import MAX_DURATION, Scenario
from coheft.wire.scenario.section import pose_of

_MOST_ROWS = 60
_DIGITS = 4  # of numbers in the scene
SECTIONS = {
    "glance": "At a glance",
    "scene": "What was held, and how it moved",
    "table": "What each robot found out",
    "errors": "Errors over time",
    "changes": "When the load changes",
    "consensus": "What the robots agree on",
    "observability": "What was observable, and when",
    "timing": "Timing",
    "run": "What was run",
}


Drawn = tuple[Picture, bytes, bytes]
"""A picture, drawn on light and on dark paper (PNG)."""


def render_page(
    scenario: Scenario, clock: str | None, series: Series, report: Report, drawn: Sequence[Drawn], data: Sequence[Path]
) -> str:
    """Return the whole page, in HTML; for a recording there is no clock, and no section about wall-clock time."""
    from coheft.app.templates import templates_beside

    robots: dict[Verdict, list[str]] = {verdict: [] for verdict in Verdict}
    for name, robot in report.robots.items():
        robots[robot.verdict].append(name)
    payload = structs.replace(scenario.payload, surface="")  # which is no setting
    unobservable = list(unobservable_rows(series))
    return (
        templates_beside(__file__)
        .get_template("page.html.jinja")
        .render(
            scenario=scenario,
            report=report,
            sections={name: title for name, title in SECTIONS.items() if name != "changes" or report.load_changes},
            missing=robots[Verdict.NOT_CONVERGED],
            contradicted=robots[Verdict.CONTRADICTED],
            poses=[pose for robot in report.robots.values() for pose in robot.poses.values()],
            sentences=sentences(report),
            headings=headings(report),
            text_headings=TEXT_HEADINGS,
            rows=table_rows(report),
            legend=legend(report),
            pictures=[(picture, _data_url(light), _data_url(dark)) for picture, light, dark in drawn],
            scene=scene_json(series),
            unobservable=unobservable[:_MOST_ROWS],
            rows_left=max(0, len(unobservable) - _MOST_ROWS),
            clock=clock,
            pace=list(series.pace),
            series=series,
            is_endless=scenario.duration >= MAX_DURATION,
            most_robots=MOST_ROBOTS,
            versions=versions(),
            scenario_text=msgspec.json.format(msgspec.json.encode(structs.replace(scenario, payload=payload))).decode(),
            data=[(path.name, TABLES[path.stem]) for path in data],
            thinned=max(robot.points.every for robot in series.robots.values()),
        )
    )


def _data_url(image: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(image).decode()}"


def unobservable_rows(series: Series) -> Iterable[tuple[str, str, str, str, str]]:
    """Yield what was not observable: what, why, robots, from, to; the same of several robots in one row."""
    when: dict[tuple[str, str], list[tuple[str, Span]]] = {}
    for name, robot in series.robots.items():
        for span in robot.spans:
            for text in (*span.not_observable, *(span.reasons if span.state is State.STALE else ())):
                when.setdefault(_kind(text), []).append((name, span))
    for (what, why), found in when.items():
        names = dict.fromkeys(name for name, _ in found)
        start, end = min(span.start for _, span in found), max(span.end for _, span in found)
        yield what, why, ", ".join(names), f"{start:.1f}", f"{end:.1f}"


def _kind(text: str) -> tuple[str, str]:
    """Return what a sentence is about, without its numbers, and the advice at its end."""
    what, _, why = text.rpartition(": ")
    return (what.partition(",")[0], why) if what else (text, "")


def scene_json(series: Series) -> str:
    """Return JSON of payload, robots and motion for the page's script: metres, seconds, quaternions scalar first."""
    scene = series.scene
    links = [[a, b] for a in scene.robots for b in scene.neighbours.get(a, []) if a < b]
    moments = list(series.moments)
    found: dict[str, Any] = {
        "robots": [
            {"name": name, "rotation": _rounded(rotation), "position": _rounded(position)}
            for name, rotation, position in zip(scene.robots, scene.rotations, scene.translations, strict=True)
        ],
        "links": links,
        "boxes": [
            {
                "size": box.size,
                "position": box.position,
                "rotation": _rounded(pose_of(box.position, box.rotation_deg).rotation),
            }
            for box in scene.boxes
        ],
        "times": [round(moment.time, _DIGITS) for moment in moments],
        "positions": [_rounded(moment.position) for moment in moments],
        "quaternions": [_rounded(moment.quaternion) for moment in moments],
        "loads": _loads(moments),
        "states": {
            name: [[round(span.start, 3), str(span.state)] for span in robot.spans]
            for name, robot in series.robots.items()
        },
    }
    return msgspec.json.encode(found).decode().replace("<", "\\u003c")  # no name ends the script


def _loads(moments: list[Truth]) -> list[tuple[float, Any]]:
    """Return the loads on the payload and the times at which they changed; one that leaks stays the same load."""
    firsts = [next(alike) for _, alike in groupby(moments, load_ids)]
    return [
        (
            round(first.time, _DIGITS),
            [{"size": load.size, "position": load.position, "mass": load.mass} for load in first.loads],
        )
        for first in firsts
    ]


def _rounded(values: Array) -> Any:
    return values.round(_DIGITS).tolist()
