"""Campaigns and schedules in the terminal."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import msgspec
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from coheft.app.faults.lasting import lasting_kinds
from coheft.app.faults.schedule import FaultSchedule
from coheft.app.faults.summary import CampaignSummary, KindSummary
from coheft.app.faults.trial import Outcome
from coheft.app.terminal.progress import show_progress
from coheft.app.terminal.wide_table import print_table

_SHOWN = 10
"""So many of the schedules that failed are shown."""


@contextmanager
def campaign_progress(console: Console, schedules: int, *, quiet: bool) -> Iterator[Callable[[Outcome], None]]:
    """Show how far a campaign has come; what is yielded has to be told every outcome."""
    with show_progress(console, "schedules", schedules, quiet=quiet) as told:
        done, failed = 0, 0

        def on_outcome(outcome: Outcome) -> None:
            nonlocal done, failed
            done += 1
            failed += bool(outcome.violations)
            told(done, f"{failed} failed")

        yield on_outcome


def print_campaign(
    console: Console,
    summary: CampaignSummary,
    outcomes: Sequence[Outcome],
    mutant: str = "",
    values: Sequence[str] = (),
) -> None:
    """What was injected and what came of it; the last line replays the first schedule that failed."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, show_edge=False, padding=(0, 1))
    table.add_column("fault", min_width=16)
    for name in ("injected", "went stale", "violations", "off, > 1 s", "median", "95 %", "worst"):
        table.add_column(name, justify="right")
    for kind in summary.kinds:
        times = ("", "", "") if kind.recovered_s is None else tuple(f"{time:.2f}" for time in kind.recovered_s)
        stale = f"{kind.went_stale}/{kind.schedules}"
        table.add_row(kind.kind, str(kind.injected), stale, str(kind.violations), _off(kind), *times)
    print_table(console, table)
    console.print("\nMedian, 95 % and worst: seconds until all robots were valid again.")
    console.print(
        f"{summary.schedules} schedules, {summary.simulated_h:.2g} simulated hours, {summary.lost} loads lost"
    )
    lies, named = summary.lies
    if lies:
        console.print(f"{named} of {lies} agents that lied were named by others")
    untold, off, long = summary.untold
    if untold:
        console.print(
            f"in {untold} schedules sensor errors exceeded their tolerances: in {off} of these a valid number was off "
            f"by more than five own std, in {long} for more than 1 s"
        )
    console.print(f"violations: {summary.violations}, in {len(summary.failed)} schedules")
    failed = [outcome for outcome in outcomes if outcome.violations]
    for outcome in failed[:_SHOWN]:
        worst = outcome.violations[0]
        text = f"{outcome.seed}: {worst.promise} at {worst.time:.2f} s, {worst.robot} {worst.what}"
        console.print(text, highlight=False, markup=False)
    if failed:
        options = [*(["--mutant", mutant] if mutant else []), *(word for value in values for word in ("--set", value))]
        command = shlex.join(["coheft", "faults", "--replay", str(failed[0].seed), *options])
        console.print(command, highlight=False, markup=False, soft_wrap=True)


def markdown(summary: CampaignSummary) -> str:
    """A campaign as a table for a document."""
    lines = [
        f"{summary.schedules} schedules (seeds {summary.seeds[0]} to {summary.seeds[1]}), {summary.simulated_h:.1f} "
        f"simulated hours: {summary.violations} violations.",
        "",
        "| fault | injected | went stale | violations | off, > 1 s | all valid again after: median | 95 % | worst |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for kind in summary.kinds:
        times = ("", "", "") if kind.recovered_s is None else tuple(f"{time:.2f} s" for time in kind.recovered_s)
        stale = f"{kind.went_stale} of {kind.schedules}"
        cells = [f"| {kind.kind}", str(kind.injected), stale, str(kind.violations), _off(kind), *times]
        lines.append(" | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _off(kind: KindSummary) -> str:
    return "{}, {}".format(*kind.off)


def print_schedule(console: Console, schedule: FaultSchedule) -> None:
    """A schedule in a few lines."""
    scenario = schedule.scenario
    console.print(
        f"seed {schedule.seed}: {scenario.robot_count} robots, {scenario.graph.kind}, {scenario.duration:g} s, "
        f"blocks of {scenario.block_duration:g} s, noise × {scenario.sensors.noise_scale:g}"
    )
    for change in scenario.load_changes:
        what = f"{change.mass:g} kg put on" if change.mass is not None else f"load {change.remove} taken away"
        what += f", which leaks {change.leak:g} kg/s" if change.leak > 0.0 else ""
        console.print(f"  {change.at:6.2f} s  {what}", highlight=False)
    if lasting := lasting_kinds(scenario):
        console.print(f"  all the time    {', '.join(lasting)}", highlight=False)
    for fault in sorted(schedule.faults, key=lambda fault: fault.start):
        fields = msgspec.to_builtins(fault)
        rest = ", ".join(f"{k} {v}" for k, v in fields.items() if k not in ("kind", "start", "end", "seed"))
        console.print(
            f"  {fault.start:6.2f} s to {fault.end:.2f} s  {fault.kind}: {rest}", highlight=False, markup=False
        )


def print_outcome(console: Console, outcome: Outcome) -> None:
    """What came out of a schedule."""
    if outcome.lost:
        console.print(f"the robots lost the load: {outcome.lost}", markup=False)
    for violation in outcome.violations:
        text = f"{violation.promise} at {violation.time:.2f} s, {violation.robot}: {violation.what}"
        worst = f" (at worst {violation.size:.1f})" if violation.size else ""
        console.print(text + worst, highlight=False, markup=False)
    first, back = (("never" if t is None else f"after {t:.2f} s") for t in (outcome.first_valid, outcome.recovered))
    console.print(f"all valid {first}; after the last fault and change of the load: {back}")
    console.print(f"violations: {len(outcome.violations)}")
