"""What a run looks like in a terminal: progress, estimates that converge, and the final table."""

from __future__ import annotations

import time
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

import numpy as np
from rich.console import Console, Group
from rich.live import Live
from rich.markup import escape
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from coheft.app.judge import RobotReport
from coheft.app.record import Record
from coheft.app.report import LoadChangeReport, Report
from coheft.wire.messages import Estimate, Problem, Truth

_LINE_EVERY = 5.0
"""Simulated time between two lines of a display that is no terminal [s]."""
_LEGEND = (
    "Centre of mass: x y z in the robot's grasp frame. Inertia: principal moments.",
    "Own std: how far off the robot itself expects to be (standard deviation).",
)
_NOT_OBSERVABLE_LINES = 3
_DRAW_EVERY = 0.2
"""Wall time between two drawings on a terminal [s]."""


class Display(Protocol):
    """Shows a run while it goes on."""

    def note(self, text: str) -> None:
        """The run does not go on now, and why."""

    def update(self, record: Record) -> None:
        """Something new has come."""

    def problem(self, problem: Problem) -> None:
        """A process refused something and went on."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


def make_display(console: Console, *, quiet: bool = False) -> Display:
    """The display that fits: nothing if quiet, a live table on a terminal, lines elsewhere."""
    if quiet:
        return QuietDisplay()
    return LiveDisplay(console) if console.is_terminal and not console.is_dumb_terminal else LineDisplay(console)


class QuietDisplay:
    """Shows nothing."""

    def note(self, text: str) -> None:
        """The run does not go on now, and why."""

    def update(self, record: Record) -> None:
        """Something new has come."""

    def problem(self, problem: Problem) -> None:
        """A process refused something and went on."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        pass


class LineDisplay(QuietDisplay):
    """One plain line for every five simulated seconds."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._lines = 0
        self._note = ""

    def note(self, text: str) -> None:
        """Print it, once."""
        if text != self._note:
            self._print(text)
        self._note = text

    def update(self, record: Record) -> None:
        """Print a line if it is time for one."""
        if record.time >= (self._lines + 1) * _LINE_EVERY:
            self._lines = int(record.time / _LINE_EVERY)
            self._print(_summary_line(record))

    def problem(self, problem: Problem) -> None:
        """A process refused something and went on."""
        self._print(f"{problem.source}: {problem.text}")

    def _print(self, text: str) -> None:
        self._console.print(text, markup=False, highlight=False, soft_wrap=True)


class LiveDisplay:
    """A progress bar over a table of all robots' estimates, drawn again a few times a second."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._live = Live(Text("starting the processes …"), console=console, auto_refresh=False, transient=True)
        self._drawn = 0.0

    def note(self, text: str) -> None:
        """Show it instead of the table."""
        self._live.update(Text(text), refresh=True)

    def update(self, record: Record) -> None:
        """Draw what is known now, unless it was drawn just before."""
        if record.truth is not None and time.monotonic() - self._drawn > _DRAW_EVERY:
            self._live.update(Group(_progress(record, record.truth), _live_table(record)), refresh=True)
            self._drawn = time.monotonic()

    def problem(self, problem: Problem) -> None:
        """A process refused something and went on: a line above the table."""
        self._console.print(f"[yellow]{escape(problem.source)}[/]: {escape(problem.text)}", highlight=False)

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._live.stop()


def _beliefs(record: Record) -> dict[str, tuple[Estimate, RobotReport]]:
    """The newest estimate of each robot and how it compares."""
    return {
        name: (record.latest[name], record.judge.robot([record.latest[name]]))
        for name in record.scene.robots
        if name in record.latest
    }


def _state(estimate: Estimate) -> str:
    if estimate.phase == "poses":
        return "finding neighbours"
    return "converged" if estimate.converged else "weighing"


def _summary_line(record: Record) -> str:
    beliefs = _beliefs(record)
    states = [_state(estimate) for estimate, _ in beliefs.values()]
    counts = ", ".join(f"{states.count(state)} {state}" for state in dict.fromkeys(states))
    line = f"{record.time:5.1f} s of {record.duration:g} s: {counts}"
    masses = [report.mass for _, report in beliefs.values() if report.mass.estimate is not None]
    if masses:
        low, high = (pick(mass.estimate for mass in masses if mass.estimate is not None) for pick in (min, max))
        line += f"; mass {low:.2f} to {high:.2f} kg (true {masses[0].truth:.2f})"
    return line


def _progress(record: Record, truth: Truth) -> Table:
    row = Table.grid(padding=(0, 1))
    bar = ProgressBar(total=record.duration, completed=record.time, width=36)
    loads = len(truth.loads)
    load = f", {loads} load{'s' * (loads != 1)} on it" if loads else ""
    row.add_row(bar, f"{record.time:.1f} of {record.duration:g} s", f"true mass {truth.payload.mass:.2f} kg{load}")
    return row


def _live_table(record: Record) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold")
    table.add_column("robot")
    table.add_column("state", min_width=18)
    table.add_column("mass", justify="right", min_width=15)
    table.add_column("centre of mass", justify="right")
    table.add_column("inertia", justify="right")
    for name, (estimate, report) in _beliefs(record).items():
        mass, com, inertia = report.mass, report.com, report.inertia
        table.add_row(
            name,
            Text(_state(estimate), style="green" if estimate.converged else "dim"),
            "" if mass.estimate is None else f"{mass.estimate:.3f} ± {mass.std or 0:.3f} kg",
            "" if com.error_mm is None else f"off {com.error_mm:.1f} mm",
            "" if inertia.error_pct is None else f"off {inertia.error_pct:.1f} %",
        )
    return table


# --- the end -----------------------------------------------------------------------------------------------------


def print_report(console: Console, report: Report, folder: Path) -> None:
    """The final table, and in sentences what else is worth knowing."""
    console.print()
    console.print(_final_table(report))
    for line in _LEGEND:
        console.print(line, style="dim", highlight=False)
    for sentence in _sentences(report):
        console.print(sentence, markup=False, highlight=False)
    console.print(f"Logs of all processes: {folder}", markup=False, highlight=False, soft_wrap=True)


def _final_table(report: Report) -> Table:
    table = Table(
        title=f"What each robot found out about the payload ({report.duration_s:.1f} s)",
        title_justify="left",
        box=None,
        padding=(0, 1, 0, 0),
        header_style="bold",
        title_style="bold",
    )
    table.add_column("robot")
    table.add_column("quantity")
    for heading in ("truth", "estimate", "error", "own std"):
        table.add_column(heading, justify="right", no_wrap=True)
    for name, robot in report.robots.items():
        for row in (_mass_row(robot), _com_row(robot), _inertia_row(robot)):
            table.add_row(name, *row)
            name = ""
    return table


def _mass_row(robot: RobotReport) -> tuple[str, str, str, str, str]:
    mass = robot.mass
    if mass.estimate is None or mass.std is None:
        return "mass, kg", f"{mass.truth:.3f}", "not observable", "", ""
    return "mass, kg", f"{mass.truth:.3f}", f"{mass.estimate:.3f}", f"{mass.error_pct:.2f} %", f"{mass.std:.3f}"


def _com_row(robot: RobotReport) -> tuple[str, str, str, str, str]:
    com = robot.com
    truth = " ".join(f"{1e3 * x:.0f}" for x in com.truth)
    if com.estimate is None or com.std is None:
        return "centre of mass, mm", truth, "not observable", "", ""
    estimate = " ".join(f"{1e3 * x:.0f}" for x in com.estimate)
    return "centre of mass, mm", truth, estimate, f"{com.error_mm:.1f} mm", f"{1e3 * np.linalg.norm(com.std):.1f}"


def _inertia_row(robot: RobotReport) -> tuple[str, str, str, str, str]:
    inertia = robot.inertia
    truth = _principal(inertia.truth)
    if inertia.estimate is None or inertia.std is None:
        return "inertia, kg·m²", truth, "not observable", "", ""
    std = float(np.linalg.norm(inertia.std))
    return "inertia, kg·m²", truth, _principal(inertia.estimate), f"{inertia.error_pct:.1f} %", f"{std:.3f}"


def _principal(tensor: list[list[float]]) -> str:
    return " ".join(f"{moment:.2f}" for moment in np.linalg.eigvalsh(np.array(tensor)))


def _sentences(report: Report) -> list[str]:
    return [
        "",
        *[_load_change_sentence(change) for change in report.load_changes],
        *_pose_sentence(report),
        *_not_observable_sentences(report),
        _convergence_sentence(report),
        f"{report.duration_s:g} s simulated at {report.real_time_factor:.1f} times real time; "
        f"{report.processes} processes, {report.messages_per_s:,.0f} messages a second.",
        *([f"{report.late_blocks} times a robot answered too late."] if report.late_blocks else []),
    ]


def _load_change_sentence(change: LoadChangeReport) -> str:
    def after(moment: float | None) -> str:
        return "not by every robot" if moment is None else f"{moment - change.at_s:.1f} s after"

    before = next((robot.mass.truth for robot in change.before_change.values()), None)
    start = f"from {before:.2f} kg " if before is not None else ""
    leak = f", leaking {change.leak_kg_s:g} kg/s" if change.leak_kg_s > 0.0 else ""
    return (
        f"At {change.at_s:g} s the payload changed {start}to {change.truth.mass:.2f} kg{leak}. "
        f"Noticed: {after(change.detected_at_s)}. Mass within 3 %, centre of mass within 20 mm at every robot: "
        f"{after(change.recovered_at_s) if change.recovered_at_s is not None else 'not reached'}."
    )


def _pose_sentence(report: Report) -> list[str]:
    poses = [pose for robot in report.robots.values() for pose in robot.poses.values()]
    if not poses:
        return []
    rotation = max(pose.rotation_error_deg for pose in poses)
    translation = max(pose.translation_error_mm for pose in poses)
    return [f"Where the neighbours hold it: off by at most {rotation:.2f}° and {translation:.1f} mm."]


def _not_observable_sentences(report: Report) -> list[str]:
    by_text: dict[str, list[str]] = {}
    for name, robot in report.robots.items():
        for text in robot.not_observable:
            by_text.setdefault(text, []).append(name)
    sentences = [f"Not observable for {', '.join(names)}: {text}." for text, names in by_text.items()]
    more = len(sentences) - _NOT_OBSERVABLE_LINES
    if more > 0:
        sentences[_NOT_OBSERVABLE_LINES:] = [f"And {more} more of the kind; the report (--json FILE) has them all."]
    return sentences


def _convergence_sentence(report: Report) -> str:
    missing = [name for name, robot in report.robots.items() if not robot.converged]
    if missing:
        return f"Not converged: {', '.join(missing)}."
    first = max(robot.converged_at_s or 0.0 for robot in report.robots.values())
    return f"All robots converged, for the first time at {first:.1f} s."
