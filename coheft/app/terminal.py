"""What a run looks like in a terminal: progress, estimates that converge, what is in doubt."""

from __future__ import annotations

import time
from types import TracebackType
from typing import Protocol, Self

from rich.console import Console, Group
from rich.live import Live
from rich.markup import escape
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from coheft.app.digits import value_and_std
from coheft.app.judge import RobotReport, why_stale
from coheft.app.record import Record
from coheft.wire.messages import Estimate, Problem, Truth

_LINE_EVERY = 5.0
"""Simulated time between two lines of a display that is no terminal [s]."""
_CHECK_EVERY = 0.5
"""Simulated time between two looks at what is stale [s]: robots notice one after the other."""
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
        self._stale: list[str] = []
        self._checked = 0.0

    def note(self, text: str) -> None:
        """Print it, once."""
        if text != self._note:
            self._print(text)
        self._note = text

    def update(self, record: Record) -> None:
        """Print a line if it is time for one; sooner, why estimates have become stale, and that none is any more."""
        if record.time >= self._checked + _CHECK_EVERY:
            self._checked = record.time
            self._tell_stale(record)
        if record.time >= (self._lines + 1) * _LINE_EVERY:
            self._lines = int(record.time / _LINE_EVERY)
            self._print(_summary_line(record))

    def problem(self, problem: Problem) -> None:
        """A process refused something and went on."""
        self._print(f"{problem.source}: {problem.text}")

    def _tell_stale(self, record: Record) -> None:
        lines = _stale_lines(record)
        for line in lines:
            if line not in self._stale:
                self._print(f"{record.time:5.1f} s: {line}")
        if self._stale and not lines:
            self._print(f"{record.time:5.1f} s: no estimate is stale any more")
        self._stale = lines

    def _print(self, text: str) -> None:
        self._console.print(text, markup=False, highlight=False, soft_wrap=True)


class LiveDisplay:
    """A progress bar over a table of all robots' estimates, drawn again a few times a second."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._live = Live(Text("waiting for the robots …"), console=console, auto_refresh=False, transient=True)
        self._drawn = 0.0

    def note(self, text: str) -> None:
        """Show it instead of the table."""
        self._live.update(Text(text), refresh=True)

    def update(self, record: Record) -> None:
        """Draw what is known now, unless it was drawn just before."""
        if record.truth is not None and time.monotonic() - self._drawn > _DRAW_EVERY:
            lines = [Text(line, "yellow", no_wrap=True, overflow="ellipsis") for line in _stale_lines(record)]
            self._live.update(Group(_progress(record, record.truth), _live_table(record), *lines), refresh=True)
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
    return {name: (estimate, record.judge.robot([estimate])) for name, estimate in record.beliefs.items()}


def _state(estimate: Estimate) -> str:
    if estimate.status == "stale":
        return "stale"
    if estimate.phase == "poses":
        return "finding neighbours"
    return "converged" if estimate.is_converged else "weighing"


_STATE_STYLES = {"stale": "yellow", "converged": "green"}


def _stale_lines(record: Record) -> list[str]:
    return [f"stale {', '.join(names)}: {reason}" for reason, names in why_stale(record.beliefs).items()]


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
    table.add_column("mass", justify="right", min_width=19)
    table.add_column("centre of mass", justify="right")
    table.add_column("inertia", justify="right")
    for name, (estimate, report) in _beliefs(record).items():
        mass, com, inertia = report.mass, report.com, report.inertia
        table.add_row(
            name,
            Text(_state(estimate), style=_STATE_STYLES.get(_state(estimate), "dim")),
            "" if mass.estimate is None else f"{value_and_std(mass.estimate, mass.std or 0.0)} kg",
            "" if com.error_mm is None else f"off {com.error_mm:.1f} mm",
            "" if inertia.error_pct is None else f"off {inertia.error_pct:.1f} %",
        )
    return table
