"""How many times faster than real time a team of processes is, and whether it keeps pace with the clock on the wall.

Whole runs of 600 blocks including the start, as ``coheft run`` makes them. A ring of 6 estimates the inertia after 70
to 150 blocks, a ring of 24 after 240 to 350. In lockstep the server waits for every robot; in real time it does not
wait, and counts answers that are late. Other load makes runs slower: the note says what the CPU time would allow on all
cores.
"""

from __future__ import annotations

import os
import resource
import tempfile
from dataclasses import dataclass
from pathlib import Path

import psutil
from rich.console import Console

from benchmarks.figures import Effort, Figure, Section, Skipped
from benchmarks.scenarios import team_scenario
from coheft.app.run.launch import launch
from coheft.app.run.plan import make_plan
from coheft.app.terminal.screen import make_display
from coheft.errors import CoheftError
from coheft.wire.config import ClockKind

_BARS = {(6, 1000): 15.0, (24, 1000): 3.0}
_BLOCKS = 600
_BLOCK = 20
_LONGER = (100, 200)
"""Durations of longer blocks, which cost nearly the same; load changes are noticed later [ms]."""
_MEMORY = 80e6
"""Memory of a process, with its share of the supervisor's [B]."""


@dataclass(frozen=True)
class Case:
    """Number of robots, rate of the sensors [Hz], clock, and duration of a block [ms]."""

    robots: int
    rate: int
    clock: ClockKind
    block: int = _BLOCK

    def __str__(self) -> str:
        return f"N = {self.robots}, {self.rate} Hz" + (f", blocks of {self.block} ms" if self.block != _BLOCK else "")


def cases(effort: Effort) -> list[Case]:
    """Return the runs to make."""
    if effort == "full":
        sizes, rates = (3, 6, 12, 24, 48), (100, 200, 500, 1000)
        clocks: tuple[ClockKind, ClockKind] = ("lockstep", "realtime")
        return [Case(robots, rate, clock) for clock in clocks for robots in sizes for rate in rates]
    chosen = [Case(6, 1000, "lockstep"), Case(6, 1000, "realtime")]
    if effort == "usual":
        chosen += [Case(robots, 1000, "lockstep") for robots in (3, 12, 24)] + [Case(6, 100, "lockstep")]
        chosen += [Case(24, 1000, "realtime", block) for block in (_BLOCK, *_LONGER[:1])]
        chosen += [Case(robots, 1000, "lockstep", block) for block in _LONGER for robots in (6, 24)]
    return chosen


def measure(effort: Effort) -> Section:
    """Make all runs."""
    figures: list[Figure] = []
    skipped: list[Skipped] = []
    for case in cases(effort):
        try:
            if (case.robots + 2) * _MEMORY > psutil.virtual_memory().available:
                raise CoheftError("not enough memory")
            figures.append(_run(case))
        except CoheftError as error:
            skipped.append(Skipped(f"{case.clock}, {case}", " ".join(str(error).split())))
    return Section(name="realtime", title="Real-time factor", figures=figures, skipped=skipped)


def _run(case: Case) -> Figure:
    duration = _BLOCKS * case.block / 1000
    scenario = team_scenario(case.robots, case.rate, case.rate * case.block // 1000, duration)
    before = _cpu_time()
    with tempfile.TemporaryDirectory() as folder:
        report = launch(make_plan(scenario, case.clock), Path(folder), make_display(Console(stderr=True), quiet=True))
    cpu = (_cpu_time() - before) / duration
    note = f"{cpu:.2f} s of CPU time per simulated second"
    if case.clock == "lockstep":
        return Figure(
            name=f"lockstep, {case}",
            value=report.real_time_factor,
            unit="times real time",
            bar=_BARS.get((case.robots, case.rate)) if case.block == _BLOCK else None,
            more_is_better=True,
            note=f"{note}: at most {(os.cpu_count() or 1) / cpu:.2f} times",
        )
    return Figure(
        name=f"answers that came too late in real time, {case}",
        value=report.late_blocks,
        unit=f"of {case.robots * scenario.blocks}",
        bar=0.0,
        note=note,
    )


def _cpu_time() -> float:
    """Return the CPU time of this process and of its children that have ended [s]."""
    return sum(
        usage.ru_utime + usage.ru_stime
        for usage in map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    )
