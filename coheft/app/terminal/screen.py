"""A run in a terminal: progress, estimates with their states, reasons for doubts."""

import re
import time
from collections import Counter
from collections.abc import Iterable
from typing import Self

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.markup import escape
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from coheft.app.results.judge import RobotReport, why_stale
from coheft.app.results.record import Record
from coheft.app.results.states import State
from coheft.app.terminal.digits import seconds_of, value_and_std
from coheft.app.terminal.wide_table import needed_width
from coheft.wire.messages.requests import Status
from coheft.wire.messages.structs import Problem
from coheft.wire.messages.truth import Truth
from coheft.wire.scenario.plugins import estimator_names
from coheft.wire.scenario.schema import MAX_DURATION

_ESTIMATORS = {
    "efficient": "efficient, which reaches the Cramér-Rao bound",
    "fan2017": "fan2017, the method of Fan et al. (CDC 2017)",
}
_LINE_EVERY = 5.0  # [s] of simulated time
_CHECK_EVERY = 0.5
"""Simulated time between two checks for stale estimates [s]: robots notice a problem one after the other."""
_LASTING = 1.0
"""Reasons for stale estimates that last less are not printed as lines [s]; every change of the load causes some."""
_DRAW_EVERY = 0.2  # [s] of wall time
_LEAST_LINES = 5
"""Smallest number of lines for a table: progress, headings, a robot, a summary of the others, a reason."""
_DIRECTION = re.compile(r" (along|about) \([^)]*\)")
"""The part of a reason that depends on the robot's own coordinates."""


class Display:
    """Base class of displays of a run in progress; shows nothing itself."""

    def begin(self, status: Status) -> None:
        """Show which run begins; all links are up."""

    def note(self, text: str) -> None:
        """Show why the run does not continue at present."""

    def tell(self, text: str) -> None:
        """Show a sentence that stays."""

    def update(self, record: Record) -> None:
        """Show the present state of the record."""

    def problem(self, problem: Problem) -> None:
        """Show a problem that a process reported."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Clean up."""


def make_display(console: Console) -> Display:
    """Make the display: none on a quiet console, a live table in a terminal, otherwise lines."""
    if console.quiet:
        return Display()
    return LiveDisplay(console) if console.is_terminal and not console.is_dumb_terminal else LineDisplay(console)


class LineDisplay(Display):
    """Prints a line for every five simulated seconds, and further lines for events in between."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._lines = 0
        self._note, self._noted_at = "", 0.0
        self._periods, self._is_noticed = 1, True
        # Since when there has been a reason for being stale, and the robots for which it has been printed.
        self._since: dict[str, float] = {}
        self._printed: dict[str, set[str]] = {}
        self._checked = 0.0

    def begin(self, status: Status) -> None:
        """Print which run begins."""
        self.tell(_first_line(status))

    def note(self, text: str) -> None:
        """Print a note, once until the run has gone on."""
        if text != self._note:
            self.tell(text)
        self._note = text

    def tell(self, text: str) -> None:
        """Print a line."""
        self._console.print(text, markup=False, highlight=False, soft_wrap=True)

    def update(self, record: Record) -> None:
        """Print a line if one is due, and events: changes of the load, and why estimates are stale."""
        if record.time > self._noted_at:
            self._note, self._noted_at = "", record.time
        if record.time >= (self._lines + 1) * _LINE_EVERY:
            self._lines = int(record.time / _LINE_EVERY)
            self.tell(_summary_line(record))
        self._print_loads(record)
        if record.time >= self._checked + _CHECK_EVERY:
            self._checked = record.time
            self._print_stale(record)

    def problem(self, problem: Problem) -> None:
        """Print a problem that a process reported."""
        self.tell(f"{problem.source}: {problem.text}")

    def _print_loads(self, record: Record) -> None:
        for period in record.periods[self._periods :]:
            self.tell(f"{period.start:5.1f} s: the payload is {period.truth.payload.mass:.2f} kg now")
            self._periods, self._is_noticed = self._periods + 1, False
        noticed = record.periods[-1].noticed if record.periods else {}
        if not self._is_noticed and len(noticed) == len(record.robots):
            self.tell(f"{max(noticed.values()):5.1f} s: all robots have noticed the change")
            self._is_noticed = True

    def _print_stale(self, record: Record) -> None:
        reasons = _why_stale(record)
        self._since = {reason: self._since.get(reason, record.time) for reason in reasons}
        for reason, names in reasons.items():
            printed = self._printed.setdefault(reason, set())
            if record.time - self._since[reason] >= _LASTING and not printed.issuperset(names):
                self.tell(f"{record.time:5.1f} s: {_stale_line(reason, names)}")
                printed.update(names)
        if any(self._printed.values()) and not reasons:
            self.tell(f"{record.time:5.1f} s: no estimate is stale any more")
        self._printed = {reason: printed for reason, printed in self._printed.items() if reason in reasons}


class LiveDisplay(Display):
    """A progress bar above a table of all robots' estimates, updated a few times per second.

    If the window is too small for all robots, those in the worst state are shown; if it is too small for a single row,
    one line summarizes all.
    """

    def __init__(self, console: Console) -> None:
        self._console = console
        self._live = Live(Text("waiting for the robots …"), console=console, auto_refresh=False, transient=True)
        self._drawn = 0.0

    def begin(self, status: Status) -> None:
        """Print which run begins, above the table."""
        self.tell(_first_line(status))

    def note(self, text: str) -> None:
        """Show a note instead of the table."""
        self._live.update(Text(text), refresh=True)

    def tell(self, text: str) -> None:
        """Print a line above the table."""
        self._console.print(text, markup=False, highlight=False)

    def update(self, record: Record) -> None:
        """Update the table, unless that was done just before."""
        if record.truth is not None and time.monotonic() - self._drawn > _DRAW_EVERY:
            self._live.update(_picture(self._console, record, record.truth), refresh=True)
            self._drawn = time.monotonic()

    def problem(self, problem: Problem) -> None:
        """Print a problem that a process reported, above the table."""
        self._console.print(f"[yellow]{escape(problem.source)}[/]: {escape(problem.text)}", highlight=False)

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()


def _first_line(status: Status) -> str:
    robots, names = len(status.scene.robots), estimator_names(status.estimator)
    used = f"estimator {_ESTIMATORS.get(names[0], names[0])}"
    if len(names) > 1:
        used = f"estimators {', '.join(names[:-1])} and {names[-1]}, side by side"
    return f"{status.scenario}: {robots} robots, {used}"


def _reports(record: Record) -> dict[str, RobotReport]:
    """Return the newest estimate of each robot, compared with the truth."""
    return {name: record.judge.robot(estimate) for name, estimate in record.beliefs.items()}


def _reports_side_by_side(record: Record) -> dict[str, RobotReport]:
    """Return the same with those of each estimator that runs beside the robots' own, named after both."""
    beside = {name: _reports(other) for name, other in record.beside.items()}
    found: dict[str, RobotReport] = {}
    for robot, report in _reports(record).items():
        found[robot] = report
        found |= {f"{robot} {name}": reports[robot] for name, reports in beside.items() if robot in reports}
    return found


_STATE_STYLES = {State.STALE: "yellow", State.CONVERGED: "green"}
_WORST_FIRST = list(State)


def _why_stale(record: Record) -> dict[str, list[str]]:
    """Return the reasons why estimates are stale, with the robots; those that differ in coordinates only are merged."""
    robots: dict[str, dict[str, None]] = {}
    for reason, names in why_stale(record.beliefs).items():
        robots.setdefault(_DIRECTION.sub(" in some directions", reason), {}).update(dict.fromkeys(names))
    return {reason: sorted(names, key=record.scene.robots.index) for reason, names in robots.items()}


def _stale_line(reason: str, names: list[str]) -> str:
    return f"stale {', '.join(names)}: {reason}"


def _counts(reports: Iterable[RobotReport]) -> str:
    counts = Counter(report.state for report in reports)
    return ", ".join(f"{count} {state}" for state, count in counts.items())


def _found_line(record: Record) -> str:
    reports = _reports(record)
    masses = [(each.mass.estimate, each.mass.truth) for each in reports.values() if each.mass.estimate is not None]
    if not masses:
        return _counts(reports.values())
    (low, _), (high, _), (_, true) = min(masses), max(masses), masses[0]
    return f"{_counts(reports.values())}; mass {low:.2f} to {high:.2f} kg (true {true:.2f})"


def _summary_line(record: Record) -> str:
    of_all = "" if record.duration >= MAX_DURATION else f" of {record.duration:g} s"
    beside = [f"{name}: {_found_line(other)}" for name, other in record.beside.items()]
    return f"{record.time:5.1f} s{of_all}: {'; '.join([_found_line(record), *beside])}"


def _picture(console: Console, record: Record, truth: Truth) -> RenderableType:
    """Return the picture of a run, with at most as many lines as the window has; in a small window a single line."""
    reports = _reports_side_by_side(record)
    lines = max(_LEAST_LINES, console.height - 1)
    stale = [_stale_line(reason, names) for reason, names in _why_stale(record).items()]
    reasons = [Text(line, "yellow", no_wrap=True, overflow="ellipsis") for line in stale]
    room = lines - 2  # for progress and headings
    most = max(room - len(reports), room // 3)
    if len(reasons) > most:
        reasons[most - 1 :] = [Text(f"and {len(reasons) - most + 1} more reasons", "yellow")]
    shown, others = _worst(reports, room - len(reasons))
    table = _live_table(shown)
    if needed_width(console, table) > console.width:
        table = _live_table(shown, gap=1)
    if lines >= console.height or needed_width(console, table) > console.width:
        return Text(_summary_line(record))
    return Group(_progress(record, truth), table, *others, *reasons)


def _worst(reports: dict[str, RobotReport], count: int) -> tuple[dict[str, RobotReport], list[Text]]:
    """Return the robots that fit into ``count`` lines, the worst state first, and a line about the others."""
    if len(reports) <= count:
        return reports, []
    by_state = sorted(reports, key=lambda name: _WORST_FIRST.index(reports[name].state))
    shown, others = by_state[: count - 1], by_state[count - 1 :]
    more = Text(f"and {len(others)} more: {_counts(reports[name] for name in others)}", "dim")
    return {name: reports[name] for name in shown}, [more]


def _progress(record: Record, truth: Truth) -> Table:
    row = Table.grid(padding=(0, 1))
    loads = len(truth.loads)
    load = f", {loads} load{'s' * (loads != 1)} on it" if loads else ""
    cells = [seconds_of(record.time, record.duration), f"true mass {truth.payload.mass:.2f} kg{load}"]
    if record.duration >= MAX_DURATION:
        row.add_row(*cells)
    else:
        row.add_column()  # the bar, the only column that shrinks
        row.add_row(ProgressBar(total=record.duration, completed=record.time, width=36), *cells)
    for column in row.columns[-2:]:
        column.no_wrap = True
    return row


def _live_table(reports: dict[str, RobotReport], gap: int = 2) -> Table:
    table = Table(box=None, padding=(0, gap, 0, 0), header_style="bold")
    table.add_column("robot", no_wrap=True)
    table.add_column("state", min_width=18, no_wrap=True)
    table.add_column("mass", justify="right", min_width=19, no_wrap=True)
    table.add_column("centre of mass", justify="right", no_wrap=True)
    table.add_column("inertia", justify="right", min_width=10, no_wrap=True)
    for name, report in reports.items():
        mass, com, inertia = report.mass, report.com, report.inertia
        table.add_row(
            name,
            Text(report.state, style="red" if report.contradictions else _STATE_STYLES.get(report.state, "dim")),
            "" if mass.estimate is None else f"{value_and_std(mass.estimate, mass.std or 0.0)} kg",
            "" if com.error_mm is None else f"off {com.error_mm:.1f} mm",
            "" if inertia.error_pct is None else f"off {inertia.error_pct:.1f} %",
        )
    return table
