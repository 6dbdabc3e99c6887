"""How many times faster than real time a team is, in processes and in one, and whether processes keep pace with it.

Whole runs of 600 blocks including the start, in lockstep and in real time as ``coheft run`` makes them, and in one
process as ``coheft.run`` in Python does. A ring of 6 estimates the inertia after 70 to 150 blocks, a ring of 24 after
240 to 350. In lockstep the server waits for every robot; in real time it does not wait, and counts answers that are
late. Other load makes runs slower: the note says what the CPU time would allow on all cores.
"""

import os
import resource
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import psutil

from benchmarks.figures import Effort, Figure, Section
from benchmarks.scenarios import team_scenario
from coheft.app.run.inprocess import run_in_process
from coheft.app.run.launch import launch
from coheft.app.run.plan import make_plan
from coheft.app.terminal.screen import Display
from coheft.errors import CoheftError

_BARS = {("lockstep", 6): 15.0, ("lockstep", 24): 3.0, ("one process", 6): 20.0}
"""For sensors at 1 kHz and blocks of 20 ms."""
_BLOCKS = 600
_BLOCK = 20
_LONGER = (100, 200)
"""Durations of longer blocks, which cost nearly the same; load changes are noticed later [ms]."""
_MEMORY = 80e6
"""Memory of a process, with its share of the supervisor's [B]."""


@dataclass(frozen=True)
class Case:
    """Number of robots, rate of the sensors [Hz], clock or 'one process', and duration of a block [ms]."""

    robots: int
    rate: int
    how: Literal["lockstep", "realtime", "one process"]
    block: int = _BLOCK

    def __str__(self) -> str:
        blocks = f", blocks of {self.block} ms" if self.block != _BLOCK else ""
        return f"{self.how}, N = {self.robots}, {self.rate} Hz{blocks}"


def cases(effort: Effort) -> list[Case]:
    """Return the runs to make."""
    if effort == "full":
        sizes, rates = (3, 6, 12, 24, 48), (100, 200, 500, 1000)
        hows: tuple[Literal["lockstep", "realtime"], ...] = ("lockstep", "realtime")
        return [Case(robots, rate, how) for how in hows for robots in sizes for rate in rates]
    chosen = [Case(6, 1000, "lockstep"), Case(6, 1000, "realtime")]
    if effort == "usual":
        chosen += [Case(robots, 1000, "lockstep") for robots in (3, 12, 24)] + [Case(6, 100, "lockstep")]
        chosen += [Case(24, 1000, "realtime", block) for block in (_BLOCK, *_LONGER[:1])]
        chosen += [Case(robots, 1000, "lockstep", block) for block in _LONGER for robots in (6, 24)]
        chosen += [Case(6, 1000, "one process", block) for block in (_BLOCK, *_LONGER)]
        chosen.append(Case(24, 1000, "one process"))
    return chosen


def measure(effort: Effort) -> Section:
    """Make all runs."""
    figures: list[Figure] = []
    skipped: dict[str, str] = {}
    for case in cases(effort):
        try:
            if (case.robots + 2) * _MEMORY > psutil.virtual_memory().available:
                raise CoheftError("not enough memory")
            figures.append(_run(case))
        except CoheftError as error:
            skipped[str(case)] = " ".join(str(error).split())
    return Section(name="realtime", title="Real-time factor", figures=figures, skipped=skipped)


def _run(case: Case) -> Figure:
    duration = _BLOCKS * case.block / 1000
    scenario = team_scenario(case.robots, case.rate, case.rate * case.block // 1000, duration)
    before, late = _cpu_time(), 0
    if case.how == "one process":
        for _ in run_in_process(scenario):
            pass
        factor = duration / (_cpu_time() - before)
    else:
        with tempfile.TemporaryDirectory() as folder:
            report = launch(make_plan(scenario, case.how), Path(folder), Display())
        factor, late = report.real_time_factor, report.late_blocks
    cpu = (_cpu_time() - before) / duration
    note = f"{cpu:.2f} s of CPU time per simulated second"
    if case.how == "realtime":
        unit = f"of {case.robots * scenario.blocks}"
        return Figure(name=f"answers that came too late, {case}", value=late, unit=unit, bar=0.0, note=note)
    cores = 1 if case.how == "one process" else os.cpu_count() or 1
    return Figure(
        name=str(case),
        value=factor,
        unit="times real time",
        bar=_BARS.get((case.how, case.robots)) if (case.rate, case.block) == (1000, _BLOCK) else None,
        more_is_better=True,
        note=f"{note}: at most {cores / cpu:.2f} times",
    )


def _cpu_time() -> float:
    """Return the CPU time of this process and of its children that have ended [s]."""
    return sum(
        usage.ru_utime + usage.ru_stime
        for usage in map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    )
