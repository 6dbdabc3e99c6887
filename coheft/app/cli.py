"""The command line. What only one command needs is imported by that command alone, so that help comes at once."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import cyclopts
from cyclopts import Parameter
from cyclopts.validators import Number

import coheft
from coheft.errors import CoheftError, ScenarioError

EXIT_CONVERGED = 0
EXIT_ERROR = 1
EXIT_USAGE = 2
EXIT_NOT_CONVERGED = 3
EXIT_INTERRUPTED = 130

app = cyclopts.App(
    name="coheft",
    help="Robots that hold one load together find out, by themselves, what they are holding.",
    help_epilogue="Exit status: 0 every robot converged (or: done), 1 an error, 2 wrong usage or a bad scenario, "
    "3 the run ended but not every robot had converged, 130 stopped by Ctrl-C.",
    version=coheft.__version__,
)

Vector = tuple[float, float, float]
RunFolder = Annotated[Path | None, Parameter(name="--run")]
Flag = Annotated[bool, Parameter(negative=(), show_default=False)]


def _is_target(_: object, value: str | None) -> None:
    if value is None or value == "-":
        return
    if value.startswith("-"):
        raise ValueError(f"expected a file, or - for standard output; found {value!r}")
    if not Path(value).absolute().parent.is_dir():
        raise ValueError(f"there is no folder {str(Path(value).parent)!r} to write {value!r} into")


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",")]


def _are_estimators(_: object, text: str) -> None:
    from agents.agent import ESTIMATORS

    words = _words(text)
    if not set(words) <= set(ESTIMATORS) or len(set(words)) < len(words):
        raise ValueError(f"expected different ones of {', '.join(ESTIMATORS)}, with commas between; found {text!r}")


def _are_factors(_: object, text: str) -> None:
    try:
        factors = [float(word) for word in _words(text)]
    except ValueError:
        factors = []
    if not factors or not all(0.0 < factor < math.inf for factor in factors) or len(set(factors)) < len(factors):
        raise ValueError(f"expected different positive numbers, with commas between; found {text!r}")


Count = Annotated[int, Parameter(validator=Number(gte=1))]
Positive = Annotated[float, Parameter(validator=Number(gt=0))]
ReportTarget = Annotated[str | None, Parameter(allow_leading_hyphen=True, validator=_is_target)]


def run_command_line(arguments: Sequence[str]) -> int:
    """Carry out one command and return the exit status; what goes wrong is said in a line, without a traceback."""
    try:
        status = app(arguments, exit_on_error=False, print_error=True, result_action="return_value")
    except cyclopts.CycloptsError:
        return EXIT_USAGE
    except ScenarioError as error:
        return _fail(error, EXIT_USAGE)
    except CoheftError as error:
        return _fail(error, EXIT_ERROR)
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return EXIT_INTERRUPTED
    return int(status or 0)


def _fail(error: CoheftError, status: int) -> int:
    print(f"coheft: {error}", file=sys.stderr)
    return status


@app.command
def run(
    scenario: str = "ring6",
    *,
    change: Annotated[list[str] | None, Parameter(negative=())] = None,
    duration: float | None = None,
    seed: int | None = None,
    estimator: str | None = None,
    sensor_rate: int | None = None,
    realtime: Flag = False,
    json: ReportTarget = None,
    history: Flag = False,
    quiet: Flag = False,
    logs: Path | None = None,
    write_configs: Path | None = None,
) -> int:
    """Start the physics server and one process per robot, and watch them find out what they hold.

    Exit status 0 only if every robot converged; 3 if the run ended without.

    Parameters
    ----------
    scenario:
        Name of a shipped scenario (see 'coheft scenarios'), or a path that ends with .toml.
    change:
        A change of the load, instead of the scenario's own: t=20,mass=3,at=0.4,0.3,0.1 drops 3 kg at 20 s, at a place
        in the payload's frame [m], with leak=0.1 it loses 0.1 kg/s from then on; t=30,remove=1 takes the first load
        away. May be given more than once.
    duration:
        Simulated time [s].
    seed:
        Of the sensors' noise and the robots' motions.
    estimator:
        The robots' method.
    sensor_rate:
        Samples per second: 100, 125, 200, 250, 500 or 1000.
    realtime:
        Keep pace with the clock on the wall, instead of going as fast as the slowest robot can.
    json:
        Write the report to this file; - for standard output.
    history:
        Add the errors of every second to the report.
    quiet:
        Show nothing but errors.
    logs:
        Folder for the processes' logs, instead of a new one among your runs.
    write_configs:
        Do not run: write the processes' configurations into this folder, to start them by hand.
    """
    from rich.console import Console

    from coheft.app.launch import launch
    from coheft.app.overrides import override
    from coheft.app.plan import make_plan
    from coheft.app.report import write_report
    from coheft.app.run_folder import make_run_folder
    from coheft.app.terminal import make_display, print_report
    from coheft.wire.scenario_file import load_scenario

    chosen = override(
        load_scenario(scenario),
        changes=change or (),
        duration=duration,
        seed=seed,
        estimator=estimator,
        sensor_rate=sensor_rate,
    )
    plan = make_plan(chosen, "realtime" if realtime else "lockstep")
    if write_configs is not None:
        for path in plan.write(write_configs):
            print(f"coheft {'server' if path.stem == 'server' else 'agent'} {path}")
        return EXIT_CONVERGED
    console = Console(stderr=json == "-")
    folder = make_run_folder(plan.run, logs)
    report = launch(plan, folder, make_display(console, quiet=quiet), with_history=history)
    if json is not None:
        write_report(report, json)
    if not quiet:
        print_report(console, report, folder)
    return EXIT_CONVERGED if report.converged else EXIT_NOT_CONVERGED


@app.command
def study(
    scenario: str = "ring6",
    *,
    runs: Count = 50,
    estimators: Annotated[str, Parameter(validator=_are_estimators)] = "seed,efficient",
    noise: Annotated[str, Parameter(validator=_are_factors)] = "1",
    at: Positive = 20.0,
    after: Positive = 1.0,
    first_seed: Annotated[int, Parameter(validator=Number(gte=0))] = 1,
    jobs: Count | None = None,
    dask: str | None = None,
    json: ReportTarget = None,
    report: Path | None = None,
    quiet: Flag = False,
) -> int:
    """Measure the estimators against the Cramér-Rao bound, over many runs in this process's own simulated network.

    Each run has a seed of its own, for the sensors' noise and for the robots' motions, and is the same for all
    estimators.

    Parameters
    ----------
    scenario:
        Name of a shipped scenario (see 'coheft scenarios'), or a path that ends with .toml.
    runs:
        Number of runs, for each noise.
    estimators:
        Which to compare.
    noise:
        Factors on the scenario's noise, for instance 1,3.
    at:
        When accuracy is judged [s]; not after the load changes.
    after:
        From the scenario's first change of the load to the judgement of the recovery [s].
    first_seed:
        Of the first run; the others count on from there.
    jobs:
        Number of processes, instead of one per core.
    dask:
        Address of a Dask scheduler; its workers run everything.
    json:
        Write the results to this file; - for standard output.
    report:
        Folder for a report with pictures.
    quiet:
        Show nothing but errors.
    """
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    from coheft.app.report import write_report
    from coheft.app.study.campaign import make_plan, run_study
    from coheft.app.study.output import make_folder, print_study, write_folder
    from coheft.wire.scenario_file import load_scenario

    plan = make_plan(
        load_scenario(scenario),
        runs=runs,
        estimators=_words(estimators),
        noise_scales=[float(factor) for factor in _words(noise)],
        at=at,
        after=after,
        first_seed=first_seed,
    )
    if report is not None:
        make_folder(report)
    console = Console(stderr=json == "-")
    columns = (TextColumn("runs"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, disable=quiet) as progress:
        bar = progress.add_task("runs", total=plan.runs)
        found, trials = run_study(
            plan, jobs=jobs, dask=dask, on_progress=lambda done: progress.update(bar, completed=done)
        )
    if json is not None:
        write_report(found, json)
    if report is not None:
        write_folder(found, trials, report)
    if not quiet:
        print_study(console, found)
    return EXIT_CONVERGED


@app.command
def scenarios() -> None:
    """List the shipped scenarios."""
    from coheft.wire.scenario_file import available_scenarios, load_scenario

    for name, path in available_scenarios().items():
        print(f"{name:10} {load_scenario(path).description}")


@app.command
def inject(*, mass: float, at: Vector, size: Vector = (0.1, 0.1, 0.1), run: RunFolder = None) -> None:
    """Drop a load onto the payload of a run that goes on.

    Parameters
    ----------
    mass:
        Of the load [kg].
    at:
        Where its centre comes to lie, in the payload's frame [m].
    size:
        Its edge lengths [m].
    run:
        Folder of the run, if it is not the newest of yours.
    """
    from coheft.app.observer import ask_run
    from coheft.wire.messages import InjectRequest

    status = ask_run(InjectRequest(mass=mass, position=at, size=size), run)
    print(f"load {status.loads[-1].id} of {mass:g} kg put on; {status.slots_free} more fit")


@app.command
def remove(load: int, *, run: RunFolder = None) -> None:
    """Take a load off the payload of a run that goes on.

    Parameters
    ----------
    load:
        Its number, as 'coheft inject' told; loads are numbered from 1 as they come.
    run:
        Folder of the run, if it is not the newest of yours.
    """
    from coheft.app.observer import ask_run
    from coheft.wire.messages import RemoveRequest

    status = ask_run(RemoveRequest(load=load), run)
    print(f"load {load} taken away; {len(status.loads)} left")


@app.command
def pause(*, run: RunFolder = None) -> None:
    """Stop the clock of a run.

    Parameters
    ----------
    run:
        Folder of the run, if it is not the newest of yours.
    """
    from coheft.app.observer import ask_run
    from coheft.wire.messages import PauseRequest

    status = ask_run(PauseRequest(paused=True), run)
    print(f"paused at {status.time:.2f} s; 'coheft resume' goes on")


@app.command
def resume(*, run: RunFolder = None) -> None:
    """Let a paused run go on.

    Parameters
    ----------
    run:
        Folder of the run, if it is not the newest of yours.
    """
    from coheft.app.observer import ask_run
    from coheft.wire.messages import PauseRequest

    status = ask_run(PauseRequest(paused=False), run)
    print(f"goes on from {status.time:.2f} s")


@app.command
def stop(*, run: RunFolder = None) -> None:
    """End a run now; whoever started it gets its report.

    Parameters
    ----------
    run:
        Folder of the run, if it is not the newest of yours.
    """
    from coheft.app.observer import ask_run
    from coheft.wire.messages import StopRequest

    status = ask_run(StopRequest(), run)
    print(f"stopped at {status.time:.2f} s")


@app.command
def watch(*, run: RunFolder = None) -> None:
    """Watch a run that goes on, until it ends.

    Parameters
    ----------
    run:
        Folder of the run, if it is not the newest of yours.
    """
    from rich.console import Console

    from coheft.app.launch import watch as watch_run
    from coheft.app.run_folder import find_run
    from coheft.app.terminal import make_display

    watch_run(find_run(run), make_display(Console()))


@app.command
def server(config: Path) -> int:
    """Start a physics server by hand.

    Parameters
    ----------
    config:
        Its configuration, as 'coheft run --write-configs DIR' writes it.
    """
    return _start_by_hand("physics_server.server", config)


@app.command
def agent(config: Path) -> int:
    """Start one robot by hand.

    Parameters
    ----------
    config:
        Its configuration, as 'coheft run --write-configs DIR' writes it.
    """
    return _start_by_hand("agents.process", config)


def _start_by_hand(module: str, config: Path) -> int:
    from coheft.app.processes import run_in_foreground

    return run_in_foreground(module, config)


__all__ = ["app", "run_command_line"]
