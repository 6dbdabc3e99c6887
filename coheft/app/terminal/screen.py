"""What a run looks like in a terminal: progress, estimates that converge, what is in doubt."""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from typing import Self

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.markup import escape
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from coheft.app.results.judge import RobotReport, why_stale
from coheft.app.results.record import Record
from coheft.app.results.states import ESTIMATORS, State
from coheft.app.terminal.digits import seconds_of, value_and_std
from coheft.app.terminal.wide_table import needed_width
from coheft.wire.messages.requests import Status
from coheft.wire.messages.structs import Estimate, Problem, Truth
from coheft.wire.scenario.schema import MAX_DURATION

_LINE_EVERY = 5.0
"""Simulated time between two lines of a display that is no terminal [s]."""
_CHECK_EVERY = 0.5
"""Simulated time between two looks at what is stale [s]: robots notice one after the other."""
_LASTING = 1.0
"""What makes estimates stale for less than this is not told in lines [s]: every change of the load does."""
_DRAW_EVERY = 0.2
"""Wall time between two drawings on a terminal [s]."""
_LEAST_LINES = 5
"""Of a window in which a picture is of use: progress, headings, a robot, how the others are, a reason."""
_DIRECTION = re.compile(r" (along|about) \([^)]*\)")
"""What every robot says in its own coordinates."""


class Display:
    """Shows a run while it goes on; this one shows nothing, and is the base of those that do."""

    def begin(self, status: Status) -> None:
        """All links stand: what is run."""

    def note(self, text: str) -> None:
        """The run does not go on now, and why."""

    def update(self, record: Record) -> None:
        """Something new has come."""

    def problem(self, problem: Problem) -> None:
        """A process refused something and went on."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Put in order what was set up."""


def make_display(console: Console, *, quiet: bool = False) -> Display:
    """The display that fits: nothing if quiet, a live table on a terminal, lines elsewhere."""
    if quiet:
        return Display()
    return LiveDisplay(console) if console.is_terminal and not console.is_dumb_terminal else LineDisplay(console)


class LineDisplay(Display):
    """One plain line for every five simulated seconds, and others for what happens in between."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._lines = 0
        self._note = ""
        self._periods, self._is_noticed = 1, True
        # Since when there has been a reason for being stale, and robots of which it was told.
        self._since: dict[str, float] = {}
        self._told: dict[str, set[str]] = {}
        self._checked = 0.0

    def begin(self, status: Status) -> None:
        """Print what is run."""
        self._print(_first_line(status))

    def note(self, text: str) -> None:
        """Print it, once."""
        if text != self._note:
            self._print(text)
        self._note = text

    def update(self, record: Record) -> None:
        """Print a line if it is time for one; sooner, what happens to the load, and why estimates are stale."""
        if record.time >= (self._lines + 1) * _LINE_EVERY:
            self._lines = int(record.time / _LINE_EVERY)
            self._print(_summary_line(record))
        self._tell_of_load(record)
        if record.time >= self._checked + _CHECK_EVERY:
            self._checked = record.time
            self._tell_stale(record)

    def problem(self, problem: Problem) -> None:
        """A process refused something and went on."""
        self._print(f"{problem.source}: {problem.text}")

    def _tell_of_load(self, record: Record) -> None:
        for period in record.periods[self._periods :]:
            self._print(f"{period.start:5.1f} s: the payload is {period.truth.payload.mass:.2f} kg now")
            self._periods, self._is_noticed = self._periods + 1, False
        noticed = record.periods[-1].noticed if record.periods else {}
        if not self._is_noticed and len(noticed) == len(record.robots):
            self._print(f"{max(noticed.values()):5.1f} s: all robots have noticed the change")
            self._is_noticed = True

    def _tell_stale(self, record: Record) -> None:
        reasons = _why_stale(record)
        self._since = {reason: self._since.get(reason, record.time) for reason in reasons}
        for reason, names in reasons.items():
            told = self._told.setdefault(reason, set())
            if record.time - self._since[reason] >= _LASTING and not told.issuperset(names):
                self._print(f"{record.time:5.1f} s: {_stale_line(reason, names)}")
                told.update(names)
        if any(self._told.values()) and not reasons:
            self._print(f"{record.time:5.1f} s: no estimate is stale any more")
        self._told = {reason: told for reason, told in self._told.items() if reason in reasons}

    def _print(self, text: str) -> None:
        self._console.print(text, markup=False, highlight=False, soft_wrap=True)


class LiveDisplay(Display):
    """A progress bar over a table of all robots' estimates, drawn again a few times a second.

    Where the window has too few lines for all robots, those are shown that are worst off; where it has not even room
    for one row, a single line stands for all.
    """

    def __init__(self, console: Console) -> None:
        self._console = console
        self._live = Live(Text("waiting for the robots …"), console=console, auto_refresh=False, transient=True)
        self._drawn = 0.0

    def begin(self, status: Status) -> None:
        """Print what is run, above the table."""
        self._console.print(_first_line(status), markup=False, highlight=False)

    def note(self, text: str) -> None:
        """Show it instead of the table."""
        self._live.update(Text(text), refresh=True)

    def update(self, record: Record) -> None:
        """Draw what is known now, unless it was drawn just before."""
        if record.truth is not None and time.monotonic() - self._drawn > _DRAW_EVERY:
            self._live.update(_picture(self._console, record, record.truth), refresh=True)
            self._drawn = time.monotonic()

    def problem(self, problem: Problem) -> None:
        """A process refused something and went on: a line above the table."""
        self._console.print(f"[yellow]{escape(problem.source)}[/]: {escape(problem.text)}", highlight=False)

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()


def _first_line(status: Status) -> str:
    robots = len(status.scene.robots)
    return f"{status.scenario}: {robots} robots, estimator {ESTIMATORS.get(status.estimator, status.estimator)}"


_Beliefs = dict[str, tuple[Estimate, RobotReport]]


def _beliefs(record: Record) -> _Beliefs:
    """The newest estimate of each robot and how it compares."""
    return {name: (estimate, record.judge.robot([estimate])) for name, estimate in record.beliefs.items()}


_STATE_STYLES = {State.STALE: "yellow", State.CONVERGED: "green"}
_WORST_FIRST = list(State)


def _why_stale(record: Record) -> dict[str, list[str]]:
    """Reasons for which estimates are stale, with the robots that give them: as if all saw from the same frame."""
    robots: dict[str, dict[str, None]] = {}
    for reason, names in why_stale(record.beliefs).items():
        robots.setdefault(_DIRECTION.sub(" in some directions", reason), {}).update(dict.fromkeys(names))
    return {reason: sorted(names, key=record.scene.robots.index) for reason, names in robots.items()}


def _stale_line(reason: str, names: list[str]) -> str:
    return f"stale {', '.join(names)}: {reason}"


def _counts(estimates: Sequence[Estimate]) -> str:
    """How many robots are how."""
    states = [State.of(estimate) for estimate in estimates]
    return ", ".join(f"{states.count(state)} {state}" for state in dict.fromkeys(states))


def _summary_line(record: Record) -> str:
    beliefs = _beliefs(record)
    counts = _counts([estimate for estimate, _ in beliefs.values()])
    of_all = "" if record.duration >= MAX_DURATION else f" of {record.duration:g} s"
    line = f"{record.time:5.1f} s{of_all}: {counts}"
    masses = [report.mass for _, report in beliefs.values() if report.mass.estimate is not None]
    if masses:
        low, high = (pick(mass.estimate for mass in masses if mass.estimate is not None) for pick in (min, max))
        line += f"; mass {low:.2f} to {high:.2f} kg (true {masses[0].truth:.2f})"
    return line


def _picture(console: Console, record: Record, truth: Truth) -> RenderableType:
    """All that is shown of a run, in no more lines than the window has; if that is too small, a single line."""
    beliefs = _beliefs(record)
    lines = max(_LEAST_LINES, console.height - 1)
    stale = [_stale_line(reason, names) for reason, names in _why_stale(record).items()]
    reasons = [Text(line, "yellow", no_wrap=True, overflow="ellipsis") for line in stale]
    room = lines - 2  # for progress and headings
    reasons = _at_most(reasons, max(room - len(beliefs), room // 3))
    shown, others = _worst(beliefs, room - len(reasons))
    table = _live_table(shown)
    if lines >= console.height or needed_width(console, table) > console.width:
        return Text(_summary_line(record))
    return Group(_progress(record, truth), table, *others, *reasons)


def _at_most(reasons: list[Text], count: int) -> list[Text]:
    """Those for which there are lines; the last one tells how many more there are."""
    if len(reasons) <= count:
        return reasons
    shown = reasons[: count - 1]
    return [*shown, Text(f"and {len(reasons) - len(shown)} more reasons", "yellow")]


def _worst(beliefs: _Beliefs, count: int) -> tuple[_Beliefs, list[Text]]:
    """Those robots for which there are lines, the worst off first, and a line about the others; all if they fit."""
    if len(beliefs) <= count:
        return beliefs, []
    by_state = sorted(beliefs, key=lambda name: _WORST_FIRST.index(State.of(beliefs[name][0])))
    shown, others = by_state[: count - 1], by_state[count - 1 :]
    more = Text(f"and {len(others)} more: {_counts([beliefs[name][0] for name in others])}", "dim")
    return {name: beliefs[name] for name in shown}, [more]


def _progress(record: Record, truth: Truth) -> Table:
    row = Table.grid(padding=(0, 1))
    if record.duration < MAX_DURATION:
        row.add_column()  # the bar, which is all that shrinks
    for _ in range(2):
        row.add_column(no_wrap=True)
    bar = ProgressBar(total=record.duration, completed=record.time, width=36)
    loads = len(truth.loads)
    load = f", {loads} load{'s' * (loads != 1)} on it" if loads else ""
    how_far = seconds_of(record.time, record.duration)
    cells = [how_far, f"true mass {truth.payload.mass:.2f} kg{load}"]
    row.add_row(*([bar, *cells] if record.duration < MAX_DURATION else cells))
    return row


def _live_table(beliefs: _Beliefs) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold")
    table.add_column("robot", no_wrap=True)
    table.add_column("state", min_width=18, no_wrap=True)
    table.add_column("mass", justify="right", min_width=19, no_wrap=True)
    table.add_column("centre of mass", justify="right", no_wrap=True)
    table.add_column("inertia", justify="right", min_width=10, no_wrap=True)
    for name, (estimate, report) in beliefs.items():
        mass, com, inertia, state = report.mass, report.com, report.inertia, State.of(estimate)
        table.add_row(
            name,
            Text(state, style="red" if report.contradictions else _STATE_STYLES.get(state, "dim")),
            "" if mass.estimate is None else f"{value_and_std(mass.estimate, mass.std or 0.0)} kg",
            "" if com.error_mm is None else f"off {com.error_mm:.1f} mm",
            "" if inertia.error_pct is None else f"off {inertia.error_pct:.1f} %",
        )
    return table
