"""Output of campaigns and schedules in the terminal."""

import math
import shlex
from collections.abc import Sequence

import msgspec
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from coheft.app.faults.lasting import lasting_kinds
from coheft.app.faults.schedule import FaultSchedule
from coheft.app.faults.summary import CampaignSummary, KindSummary
from coheft.app.faults.trial import Outcome
from coheft.app.faults.unlike import differences
from coheft.app.terminal.wide_table import print_table

_SHOWN = 10
"""Largest number of failed schedules that are shown."""


def print_campaign(
    console: Console, summary: CampaignSummary, outcomes: Sequence[Outcome], mutant: str, values: Sequence[str]
) -> None:
    """Print the injected faults and their effects; the last line replays the first schedule that failed."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, show_edge=False, padding=(0, 1))
    table.add_column("fault", min_width=16)
    for name in ("injected", "went stale", "violations", "off, > 1 s", "median", "95 %", "worst"):
        table.add_column(name, justify="right")
    for kind in summary.kinds:
        table.add_row(*_cells(kind, of="/", unit=""))
    print_table(console, table)
    console.print("\nMedian, 95 % and worst: seconds until all robots were valid again.")
    console.print(
        f"{summary.schedules} schedules, {summary.simulated_h:.2g} simulated hours, {summary.lost} loads lost"
    )
    lies, named = summary.lies
    if lies:
        console.print(f"{named} of {lies} agents that lied were named by others")
    undeclared, off, long = summary.undeclared
    if undeclared:
        console.print(
            f"in {undeclared} schedules sensor errors exceeded their tolerances: in {off} of these a valid number was "
            f"off by more than five own std, in {long} for more than 1 s"
        )
    console.print(f"violations: {summary.violations}, in {len(summary.failed)} schedules")
    failed = [outcome for outcome in outcomes if outcome.violations]
    for outcome in failed[:_SHOWN]:
        first = outcome.violations[0]
        text = f"{outcome.seed}: {first.promise} at {first.time:.2f} s, {first.robot} {first.what}"
        console.print(text, highlight=False, markup=False)
    if failed:
        options = [*(["--mutant", mutant] if mutant else []), *(word for value in values for word in ("--set", value))]
        command = shlex.join(["coheft", "faults", "--replay", str(failed[0].seed), *options])
        console.print(command, highlight=False, markup=False, soft_wrap=True)


def markdown(summary: CampaignSummary) -> str:
    """Return a campaign's results as a table in Markdown."""
    lines = [
        f"{summary.schedules} schedules (seeds {summary.seeds[0]} to {summary.seeds[1]}), {summary.simulated_h:.1f} "
        f"simulated hours: {summary.violations} violations.",
        "",
        "| fault | injected | went stale | violations | off, > 1 s | all valid again after: median | 95 % | worst |",
        "|---|---|---|---|---|---|---|---|",
    ]
    lines += [f"| {' | '.join(_cells(kind, of=' of ', unit=' s'))} |" for kind in summary.kinds]
    return "\n".join(lines) + "\n"


def _cells(kind: KindSummary, *, of: str, unit: str) -> list[str]:
    """Return the row of a kind of fault, in both tables."""
    times = [""] * 3 if kind.recovered_s is None else [f"{time:.2f}{unit}" for time in kind.recovered_s]
    stale, off = f"{kind.went_stale}{of}{kind.schedules}", f"{kind.off[0]}, {kind.off[1]}"
    return [kind.kind, str(kind.injected), stale, str(kind.violations), off, *times]


def print_schedule(console: Console, schedule: FaultSchedule) -> None:
    """Print a schedule in a few lines."""
    scenario = schedule.scenario
    console.print(
        f"seed {schedule.seed}: {scenario.robot_count} robots, {scenario.graph.kind}, {scenario.duration:g} s, "
        f"blocks of {scenario.block_duration:g} s, noise × {scenario.sensors.noise_scale:g}"
    )
    for change in scenario.load_changes:
        what = f"{change.mass:g} kg put on" if change.mass is not None else f"load {change.remove} taken away"
        what += f", which leaks {change.leak:g} kg/s" if change.leak > 0.0 else ""
        console.print(f"  {change.at:6.2f} s  {what}", highlight=False)
    for slip in scenario.slips:
        length, turn = 1e3 * math.hypot(*slip.translation), math.hypot(*slip.rotation_deg)
        console.print(f"  {slip.at:6.2f} s  {slip.robot} slips by {length:.0f} mm and {turn:.1f}°", highlight=False)
    for each in scenario.sensors.of:
        console.print(f"  all the time    {each.robot}: {', '.join(differences(each))}", highlight=False)
    if lasting := lasting_kinds(scenario):
        console.print(f"  all the time    {', '.join(lasting)}", highlight=False)
    for fault in sorted(schedule.faults, key=lambda fault: fault.start):
        fields = msgspec.to_builtins(fault)
        rest = ", ".join(f"{k} {v}" for k, v in fields.items() if k not in ("kind", "start", "end", "seed"))
        console.print(
            f"  {fault.start:6.2f} s to {fault.end:.2f} s  {fault.kind}: {rest}", highlight=False, markup=False
        )


def print_outcome(console: Console, outcome: Outcome) -> None:
    """Print the outcome of a schedule."""
    if outcome.lost:
        console.print(f"the robots lost the load: {outcome.lost}", markup=False)
    for violation in outcome.violations:
        text = f"{violation.promise} at {violation.time:.2f} s, {violation.robot}: {violation.what}"
        worst = f" (at worst {violation.size:.1f})" if violation.size else ""
        console.print(text + worst, highlight=False, markup=False)
    first, back = (("never" if t is None else f"after {t:.2f} s") for t in (outcome.first_valid, outcome.recovered))
    console.print(f"all valid {first}; after the last fault and change of the load: {back}")
    console.print(f"violations: {len(outcome.violations)}")
