"""The report as one page that needs nothing but itself."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from coheft.app.results.judge import Verdict
from coheft.app.results.report import Report
from coheft.app.results.states import State
from coheft.app.run_report.data import TABLES
from coheft.app.run_report.pictures import Picture
from coheft.app.run_report.scene import scene_json
from coheft.app.run_report.series import Series
from coheft.app.terminal.final_table import HEADINGS, LEGEND, RECOVERED, robot_rows, sentences
from coheft.app.versions import versions
from coheft.wire.scenario.schema import MAX_DURATION, Scenario

_MOST_ROWS = 60
SECTIONS = {
    "glance": "At a glance",
    "scene": "What was held, and how it moved",
    "table": "What each robot found out",
    "errors": "Errors over time",
    "changes": "When the load changes",
    "consensus": "What the robots agree on",
    "observability": "What could be told, and when",
    "timing": "Timing",
    "run": "What was run",
}


@dataclass(frozen=True)
class Drawn:
    """A picture, drawn on light and on dark paper (PNG)."""

    picture: Picture
    light: bytes
    dark: bytes

    @property
    def sources(self) -> tuple[str, str]:
        """Both as addresses that hold the data itself."""
        light, dark = (base64.b64encode(image).decode() for image in (self.light, self.dark))
        return f"data:image/png;base64,{light}", f"data:image/png;base64,{dark}"


@dataclass(frozen=True)
class Fact:
    """A number worth a card: what, how much, and what to compare it with."""

    title: str
    value: str
    note: str


def render_page(
    scenario: Scenario, clock: str | None, series: Series, report: Report, drawn: Sequence[Drawn], data: Sequence[Path]
) -> str:
    """The whole page, in HTML; of a recording no clock is known, and nothing is said about time on the wall."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    robots: dict[Verdict, list[str]] = {verdict: [] for verdict in Verdict}
    for name, robot in report.robots.items():
        robots[robot.verdict].append(name)
    return environment.get_template("page.html.jinja").render(
        scenario=scenario,
        report=report,
        sections={name: title for name, title in SECTIONS.items() if name != "changes" or report.load_changes},
        is_good=report.converged,
        missing=robots[Verdict.NOT_CONVERGED],
        contradicted=robots[Verdict.CONTRADICTED],
        facts=facts(report, has_pace=clock is not None),
        sentences=sentences(report),
        headings=HEADINGS,
        rows={name: robot_rows(robot) for name, robot in report.robots.items()},
        legend=[*LEGEND, *([RECOVERED] if report.load_changes else [])],
        pictures=drawn,
        scene=scene_json(series),
        boxes=series.scene.boxes,
        unseen=list(unseen_rows(series))[:_MOST_ROWS],
        unseen_left=max(0, len(list(unseen_rows(series))) - _MOST_ROWS),
        timing=timing_rows(clock, series, report),
        problems=series.problems,
        problems_left=series.problem_count - len(series.problems),
        run=run_rows(scenario, clock, report),
        versions=versions(),
        scenario_text=msgspec.json.format(msgspec.json.encode(_without_surface(scenario))).decode(),
        data=[(path.name, TABLES[path.stem]) for path in data],
        thinned=max(robot.points.every for robot in series.robots.values()),
    )


def facts(report: Report, *, has_pace: bool = True) -> list[Fact]:
    """The run in a few numbers: of each quantity the error of the robot that is furthest off."""
    robots = report.robots.values()
    poses = [pose for robot in robots for pose in robot.poses.values()]
    found = [
        Fact("mass", _largest((r.mass.error_pct for r in robots), "%"), "largest error of any robot"),
        Fact("centre of mass", _largest((r.com.error_mm for r in robots), "mm"), "largest error of any robot"),
        Fact("inertia", _largest((r.inertia.error_pct for r in robots), "%"), "largest error of any robot"),
        Fact("neighbours, rotation", _largest((p.rotation_error_deg for p in poses), "°"), "largest error"),
        Fact("neighbours, translation", _largest((p.translation_error_mm for p in poses), "mm"), "largest error"),
    ]
    for change in report.load_changes[:1]:
        noticed = change.detected_at_s
        found.append(
            Fact(
                f"load change at {change.at_s:g} s",
                "not noticed by all" if noticed is None else f"{noticed - change.at_s:.2f} s",
                "until the last robot had noticed",
            )
        )
    return [*found, *([Fact("pace", f"{report.real_time_factor:.1f} ×", "real time")] if has_pace else [])]


def _largest(values: Iterable[float | None], unit: str) -> str:
    known = [value for value in values if value is not None]
    return f"{max(known):.2g}{' ' * (unit != '°')}{unit}" if known else "not known"


def unseen_rows(series: Series) -> Iterable[tuple[str, str, str, str, str]]:
    """What could not be told and why not: what, why, who, from, to; the same of several robots in one row."""
    when: dict[tuple[str, str], dict[str, tuple[float, float]]] = {}
    for name, robot in series.robots.items():
        for span in robot.states.spans:
            texts = [*span.not_observable, *(span.reasons if span.state is State.STALE else ())]
            for text in texts:
                place = when.setdefault(_kind(text), {})
                start, _ = place.get(name, (span.start, span.end))
                place[name] = (start, span.end)
    for (what, why), robots in when.items():
        start, end = min(s for s, _ in robots.values()), max(e for _, e in robots.values())
        yield what, why, ", ".join(robots), f"{start:.1f}", f"{end:.1f}"


def _kind(text: str) -> tuple[str, str]:
    """What a sentence is about, without its numbers, and the advice at its end."""
    what, _, why = text.rpartition(": ")
    return (what.partition(",")[0], why) if what else (text, "")


def timing_rows(clock: str | None, series: Series, report: Report) -> list[tuple[str, str]]:
    """How fast it went."""
    refused = ("refused messages and other problems", f"{series.problem_count}")
    if clock is None:
        return [("simulated", f"{report.duration_s:g} s"), ("on the wall", "a recording does not tell"), refused]
    pace = list(series.pace)
    late = f"{report.late_blocks}" if clock == "realtime" else "none: the clock waits for all robots"
    return [
        ("simulated", f"{report.duration_s:g} s"),
        ("on the wall", f"{pace[-1][1] - pace[0][1]:.1f} s, pauses included"),
        ("real-time factor", f"{report.real_time_factor:.2f}"),
        ("processes", f"{report.processes}"),
        ("messages between processes", f"{report.messages_per_s:,.0f} per second"),
        ("late blocks", late),
        refused,
    ]


def run_rows(scenario: Scenario, clock: str | None, report: Report) -> list[tuple[str, str]]:
    """What was run."""
    sensors = scenario.sensors
    clocks = {
        "lockstep": "lockstep: as fast as the slowest robot",
        "paced": "real time, or slower where robots cannot keep pace",
        "realtime": "real time",
    }
    return [
        ("scenario", scenario.name),
        ("seed", f"{report.seed}"),
        ("estimator", ", then ".join(_estimators(scenario, report))),
        ("robots", f"{len(report.robots)}, linked in a {scenario.graph.kind}"),
        ("duration", f"{report.duration_s:g} s" + _planned(scenario.duration)),
        ("sensors", f"{sensors.rate} samples per second, in blocks of {sensors.block}"),
        *([] if clock is None else [("clock", clocks[clock])]),
    ]


def _without_surface(scenario: Scenario) -> Scenario:
    """What a payload from a file looks like is no setting."""
    payload = msgspec.structs.replace(scenario.payload, surface="")
    return msgspec.structs.replace(scenario, payload=payload)


def _planned(duration: float) -> str:
    return ", until it was stopped" if duration >= MAX_DURATION else f" of {duration:g} s"


def _estimators(scenario: Scenario, report: Report) -> Iterable[str]:
    if not report.estimator_changes:
        return [report.estimator]
    changes = [f"{change.estimator} from {change.since_s:g} s on" for change in report.estimator_changes]
    return [scenario.estimator, *changes]
