"""The command line. What only one command needs is imported by that command alone, so that help comes at once."""

from __future__ import annotations

import os
import re
import sys
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import cyclopts
from cyclopts import Parameter

from coheft.app import (
    cli_cart,
    cli_control,
    cli_faults,
    cli_identify,
    cli_keys,
    cli_mocobots,
    cli_recover,
    cli_ros2,
    cli_shell,
    cli_study,
    cli_view,
)
from coheft.app.cli_base import (
    EXIT_CONVERGED,
    EXIT_ERROR,
    EXIT_INTERRUPTED,
    EXIT_NOT_CONVERGED,
    EXIT_USAGE,
    PARTS,
    RUN,
    DataTarget,
    Flag,
    NotNegative,
    RecordingTarget,
    ReportTarget,
    app,
)
from coheft.app.cli_errors import complain, explain_usage
from coheft.errors import CoheftError, ScenarioError

_WIDTH = 80
"""Of a terminal, in columns."""


def run_command_line(arguments: Sequence[str]) -> int:
    """Carry out one command and return the exit status; what goes wrong is said in a line, without a traceback."""
    try:
        status = app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
        sys.stdout.flush()
    except cyclopts.CycloptsError as error:
        return _fail(explain_usage(error), EXIT_USAGE)
    except ScenarioError as error:
        return _fail(str(error), EXIT_USAGE)
    except CoheftError as error:
        return _fail(str(error), EXIT_ERROR)
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return EXIT_INTERRUPTED
    except BrokenPipeError:  # whoever read our output has seen enough, as 'head' does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_ERROR
    return int(status or 0)


def _fail(text: str, status: int) -> int:
    complain(text)
    return status


@app.command(group=RUN)
def run(
    scenario: str = "ring6",
    *,
    change: Annotated[list[str] | None, Parameter(negative=())] = None,
    duration: float | None = None,
    seed: int | None = None,
    estimator: str | None = None,
    sensor_rate: int | None = None,
    realtime: Flag = False,
    restarts: NotNegative = 3,
    json: ReportTarget = None,
    history: Flag = False,
    report: Path | None = None,
    quiet: Flag = False,
    save_data: DataTarget = None,
    record: RecordingTarget = None,
    view: Flag = False,
    logs: Path | None = None,
    secure: Flag = False,
    keys: Path | None = None,
    hosts: Path | None = None,
    write_configs: Path | None = None,
    feedforward: bool | None = None,
) -> int:
    """Start the physics server and one process per robot, and watch them find out what they hold.

    Exit status 0 only if every robot converged and no estimate is stale; 3 if the run ended without.

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
        The robots' method: efficient or seed.
    sensor_rate:
        Samples per second: 100, 125, 200, 250, 500 or 1000.
    realtime:
        Keep pace with the clock on the wall, instead of going as fast as the slowest robot can.
    restarts:
        How often an agent that dies is started again; once more, and the run ends with an error.
    json:
        Write the report to this file; - for standard output.
    history:
        Add the errors of every second to the report.
    report:
        Folder for a page with pictures, the pictures, and the data behind them; takes coheft[report].
    quiet:
        Show nothing but errors.
    save_data:
        Save what all robots measured, for 'coheft identify': an .npz file, or, without suffix, a folder of CSV files.
    record:
        Record the run to this new .mcap file, for 'coheft view', Foxglove and PlotJuggler, see docs/recording.md.
    view:
        Show the run in the browser, in real time; the last picture stays until Ctrl-C. See docs/view.md.
    logs:
        Folder for the processes' logs, instead of a new one among your runs.
    secure:
        Let nobody join who has no certificate, and nobody speak for another.
    keys:
        Folder with everybody's certificates, as 'coheft keys' makes it, instead of new ones for this run alone.
    hosts:
        File that tells where each part runs, see docs/deployment.md; with --write-configs.
    write_configs:
        Do not run: write the processes' configurations into this folder, to start them by hand.
    feedforward:
        Where robots carry the load along a common path: whether they push with what they know of it.
    """
    from contextlib import ExitStack

    from msgspec import structs
    from rich.console import Console

    from coheft.app.final_table import print_report
    from coheft.app.follower import Follower
    from coheft.app.hosts import LOOPBACK, load_hosts
    from coheft.app.launch import launch
    from coheft.app.overrides import override
    from coheft.app.plan import make_plan, new_run_name
    from coheft.app.report import write_report
    from coheft.app.run_folder import make_run_folder
    from coheft.app.run_report.folder import prepare_folder, write_folder
    from coheft.app.run_report.series import SeriesFollower
    from coheft.app.terminal import make_display
    from coheft.wire.scenario_file import load_scenario

    if report is not None:
        prepare_folder(report)
    chosen = override(
        load_scenario(scenario),
        changes=change or (),
        duration=duration,
        seed=seed,
        estimator=estimator,
        sensor_rate=sensor_rate,
        feedforward=feedforward,
    )
    if write_configs is not None and (record is not None or view):
        raise ScenarioError(f"{'--view' if view else '--record'} needs a run, but --write-configs makes none")
    if record is not None:
        from coheft.app.recording.recorder import Recorder
    if view:
        from coheft.app.view.process import ViewBeside
    if hosts is not None and write_configs is None:
        raise ScenarioError("--hosts needs --write-configs: each part is to be started on its own host")
    places = load_hosts(hosts, chosen) if hosts is not None else None
    name = new_run_name()
    folder = write_configs if write_configs is not None else make_run_folder(name, logs)
    if secure or keys is not None:
        from coheft.app.keys import check_keys, make_keys

        if keys is None:
            keys = folder / "keys"
            make_keys(keys, chosen, places)
        check_keys(keys, chosen, places)
    plan = make_plan(
        chosen, "realtime" if realtime or view else "lockstep", run=name, hosts=places, keys=keys, save_data=save_data
    )
    if write_configs is not None:
        for path in plan.write(write_configs):
            print(f"coheft {'server' if path.stem == 'server' else 'agent'} {path}")
        return EXIT_CONVERGED
    console = Console(stderr=json == "-")
    display = make_display(console, quiet=quiet)
    over_time = SeriesFollower() if report is not None else None
    carried = None
    if chosen.carry is not None:
        from coheft.app.carry_record import CarryRecord

        carried = CarryRecord(chosen)
    with ExitStack() as stack:
        followers: list[Follower] = [] if over_time is None else [over_time]
        viewer = None
        if view:
            viewer = stack.enter_context(
                ViewBeside(folder, LOOPBACK, None, lambda url: console.print(f"the view is at {url}"))
            )
            followers.append(viewer)
        if record is not None:
            followers.append(stack.enter_context(Recorder(record, chosen)))
        if carried is not None:
            followers.append(carried)
        found = launch(plan, folder, display, followers=followers, with_history=history, restarts=restarts)
        if carried is not None:
            found = structs.replace(found, carry=carried.report())
        if json is not None:
            write_report(found, json)
        if not quiet:
            print_report(console, found, folder)
        if report is not None and over_time is not None:
            page = write_folder(report, chosen, plan.server.clock, over_time.series, found)
            if not quiet:
                console.print(f"Report: {page}", markup=False, highlight=False, soft_wrap=True)
        if viewer is not None and viewer.is_there:
            if not quiet:
                console.print(f"The view stays at {viewer.url} until Ctrl-C.")
            viewer.wait()
    return EXIT_CONVERGED if found.converged else EXIT_NOT_CONVERGED


@app.command(group=RUN)
def scenarios() -> None:
    """List the shipped scenarios."""
    from coheft.wire.scenario_file import available_scenarios, load_scenario

    shipped = available_scenarios()
    column = max(map(len, shipped)) + 2
    for name in sorted(shipped, key=_by_number):
        text = f"{name:{column}}{load_scenario(shipped[name]).description}"
        print(textwrap.fill(text, _WIDTH, subsequent_indent=" " * column))


def _by_number(name: str) -> list[tuple[int, str]]:
    """Key that sorts ring3 before ring12."""
    return [(int(part), "") if part.isdigit() else (0, part) for part in re.split(r"(\d+)", name)]


@app.command(group=PARTS)
def server(config: Path) -> int:
    """Start a physics server by hand.

    Parameters
    ----------
    config:
        Its configuration, as 'coheft run --write-configs DIR' writes it.
    """
    return _start_by_hand("physics_server.server", config)


@app.command(group=PARTS)
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


__all__ = [
    "EXIT_CONVERGED",
    "EXIT_ERROR",
    "EXIT_USAGE",
    "app",
    "cli_cart",
    "cli_control",
    "cli_faults",
    "cli_identify",
    "cli_keys",
    "cli_mocobots",
    "cli_recover",
    "cli_ros2",
    "cli_shell",
    "cli_study",
    "cli_view",
    "run_command_line",
]
