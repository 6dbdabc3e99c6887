"""The command that injects faults."""

from __future__ import annotations

from bisect import insort
from functools import partial
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from coheft.app.cli import options
from coheft.app.cli.base import EVALUATE, EXIT_BROKEN_PROMISE, EXIT_CONVERGED, app
from coheft.errors import CoheftError, UsageError, file_errors

if TYPE_CHECKING:
    from rich.console import Console

    from coheft.app.faults.schedule import FaultSchedule
    from coheft.app.faults.trial import Outcome

_SEEDS = 100
_FAILED = Path("faults-failed")
"""Folder for schedules that have failed."""


def _is_mutant(_: object, name: str) -> None:
    from coheft.app.faults.mutants import MUTANTS

    if name and name not in MUTANTS:
        raise ValueError(f"there is no mutant {name!r}; available: {', '.join(MUTANTS)}")


@app.command(group=EVALUATE)
def faults(
    *,
    seeds: options.Count = _SEEDS,
    first_seed: options.NotNegative | None = None,
    jobs: options.Jobs = None,
    json: options.ReportTarget = None,
    table: options.FileTarget = None,
    kept: options.FileTarget = None,
    failed: options.FolderTarget = None,
    mutant: Annotated[str, Parameter(validator=_is_mutant)] = "",
    set: Annotated[list[str] | None, Parameter(negative=())] = None,
    replay: str | None = None,
    shrink: options.Flag = False,
    quiet: options.Quiet = False,
) -> int:
    """Inject faults into many simulated runs, and check after every block that the promises are kept.

    Each seed draws a small team and up to four faults of the network, agents, sensors or clocks. In half of the runs
    the sensors also have small lasting errors; in three of ten robots differ, or one slips, see docs/faults.md. Exit
    status 4 if a promise was broken; the last line is then the command that reproduces it.

    Args:
        seeds: Number of runs.
        first_seed: Seed of the first run, by default drawn from the clock; the others follow consecutively.
        table: Write a table of the injected faults and their effects to this file, in Markdown.
        kept: Append every outcome to this file, so that an interrupted campaign can continue. Outcomes of other code or
            of another mutant are refused.
        failed: Folder for schedules that break a promise, by default 'faults-failed'; --replay FILE runs them again
            even if seeds draw something else by then.
        mutant: Put this deliberate bug into the agents; the campaign has to find it.
        set: Fix a key of the scenario that is otherwise drawn, in TOML syntax, for instance sensors.rate=200. May be
            repeated. Robots, graph, duration and seed are always drawn.
        replay: Instead of a campaign, run the schedule of this seed, or in this .json file, and print everything that
            happens.
        shrink: With --replay: find the simplest schedule that still fails, and write it to a file.
    """
    from rich.console import Console

    from coheft.app.faults.campaign import run_campaign, usual_first_seed
    from coheft.app.faults.draw import draw_schedule
    from coheft.app.faults.output import markdown, print_campaign
    from coheft.app.faults.summary import summarise
    from coheft.app.outputs import write_outputs, write_text
    from coheft.app.results.report import write_report
    from coheft.app.terminal.progress import show_progress

    of_campaigns = {
        "first-seed": first_seed,
        "jobs": jobs,
        "json": json,
        "table": table,
        "kept": kept,
        "failed": failed,
    }
    unusable = ["seeds"] * (seeds != _SEEDS) + [name for name, value in of_campaigns.items() if value is not None]
    if unusable and replay is not None:
        raise UsageError(f"--{unusable[0]} is for a campaign, but --replay runs a single schedule")
    if shrink and replay is None:
        raise UsageError("--shrink simplifies one schedule: name it with --replay SEED or --replay FILE")
    options.check_outputs(json=json, table=table, kept=kept)
    values = set or []
    console = Console(stderr=json == "-", quiet=quiet)
    if replay is not None:
        return _replay(console, _schedule_of(replay, values), mutant, is_shrunk=shrink)
    if first_seed is None:
        first_seed = usual_first_seed(kept)
    chosen = range(first_seed, first_seed + seeds)
    console.print(f"first seed {first_seed}", highlight=False)
    draw_schedule(first_seed, values=values)  # reports invalid values before anything starts
    outcomes: list[Outcome] = []
    failures = 0
    try:
        with show_progress(console, "schedules", seeds) as show:
            for outcome in run_campaign(chosen, jobs=jobs, kept=kept, mutant=mutant, values=values):
                insort(outcomes, outcome, key=lambda each: each.seed)
                failures += bool(outcome.violations)
                show(f"{failures} failed")
                if outcome.violations and not mutant:
                    _keep_failed(outcome.seed, values, failed or _FAILED)
    except KeyboardInterrupt:
        if outcomes:
            print_campaign(console, summarise(outcomes), outcomes, mutant, values)
        unwritten = [what for what, place in (("summary (--json)", json), ("table (--table)", table)) if place]
        clauses = [f"stopped after {len(outcomes)} of {seeds} schedules"]
        clauses += [f"no {what} was written" for what in unwritten]
        clauses += [] if kept is None else [f"the same command continues with the outcomes in {kept}"]
        raise KeyboardInterrupt("; ".join(clauses)) from None
    summary = summarise(outcomes)
    print_campaign(console, summary, outcomes, mutant, values)
    write_outputs(
        (json, lambda target: write_report(summary, target)), (table, lambda path: write_text(path, markdown(summary)))
    )
    return EXIT_BROKEN_PROMISE if summary.violations else EXIT_CONVERGED


def _keep_failed(seed: int, values: list[str], folder: Path) -> None:
    from coheft.app.faults.draw import draw_schedule
    from coheft.app.faults.schedule import write_schedule

    with file_errors(CoheftError, f"cannot write {folder / str(seed)}.json"):
        folder.mkdir(parents=True, exist_ok=True)
        write_schedule(draw_schedule(seed, values=values), folder / f"{seed}.json")


def _schedule_of(text: str, values: list[str]) -> FaultSchedule:
    from coheft.app.faults.draw import draw_schedule
    from coheft.app.faults.schedule import read_schedule

    if text.isdecimal():
        return draw_schedule(int(text), values=values)
    if values:
        raise UsageError(f"--set changes what is drawn, but {text} holds a whole schedule: change it there")
    return read_schedule(Path(text))


def _replay(console: Console, schedule: FaultSchedule, mutant: str, *, is_shrunk: bool) -> int:
    from coheft.app.faults.mutants import mutated
    from coheft.app.faults.output import print_outcome, print_schedule
    from coheft.app.faults.schedule import write_schedule
    from coheft.app.faults.shrink import breaks, shrink
    from coheft.app.faults.trial import try_schedule

    with mutated(mutant):
        outcome = try_schedule(schedule)
        if is_shrunk and not outcome.violations:
            console.print("the schedule breaks no promise, so there is nothing to simplify")
        elif is_shrunk:
            simplest = schedule
            for simplest in shrink(schedule, partial(breaks, {violation.promise for violation in outcome.violations})):
                print_schedule(console, simplest)
            if simplest == schedule:
                console.print("the schedule cannot be simplified: anything simpler keeps these promises")
            else:
                schedule, outcome = simplest, try_schedule(simplest)
                stem = f"faults-{schedule.seed}"
                names = (f"{stem}-{number}.json" if number > 1 else f"{stem}.json" for number in count(1))
                path = next(path for path in map(Path, names) if not path.exists())  # may be a simplified one's
                write_schedule(schedule, path)
                console.print(f"written to {path}")
    print_schedule(console, schedule)
    print_outcome(console, outcome)
    return EXIT_BROKEN_PROMISE if outcome.violations else EXIT_CONVERGED
