"""Commands for a run in progress."""

from pathlib import Path
from time import localtime, strftime
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from coheft.app.cli import options
from coheft.app.cli.base import CONTROL, app
from coheft.errors import CoheftError, LinkError, UsageError

Robot = Annotated[str, Parameter(help="A robot, for instance r1.")]
Share = Annotated[float, Parameter(validator=Number(gte=0, lte=1))]
Neighbour = Annotated[str, Parameter(help="Its neighbour.")]


@app.command(group=CONTROL)
def inject(
    *, mass: float, at: options.Vector, size: options.Vector = (0.1, 0.1, 0.1), run: options.RunFolder = None
) -> None:
    """Drop a load onto the payload of a run in progress.

    Args:
        mass: Mass of the load [kg].
        at: Position of its centre, in the payload's frame [m].
        size: Its edge lengths [m].
    """
    from coheft.app.run.observer import ask_run
    from coheft.wire.messages.requests import InjectRequest

    status = ask_run(InjectRequest(mass=mass, position=at, size=size), run)
    slots = len(status.loads) + status.slots_free
    free = f"{status.slots_free} of {slots} load slots are free"
    print(f"load {status.loads[-1].id} ({mass:g} kg) is on the payload; {free}")


@app.command(group=CONTROL)
def remove(load: options.Whole, *, run: options.RunFolder = None) -> None:
    """Take a load off the payload of a run in progress.

    Args:
        load: Number of the load, as printed by 'coheft inject'; loads are numbered from 1 in order of arrival.
    """
    from coheft.app.run.observer import ask_run
    from coheft.wire.messages.requests import RemoveRequest

    status = ask_run(RemoveRequest(load=load), run)
    print(f"load {load} taken away; {len(status.loads)} left")


@app.command(group=CONTROL)
def release(robot: Robot, *, run: options.RunFolder = None) -> None:
    """Let a robot release the payload."""
    time = _set_holding(run, robot, holding=False)
    print(f"{robot} released the payload at {time:.2f} s; 'coheft grasp {robot}' makes it grasp again")


@app.command(group=CONTROL)
def grasp(robot: Robot, *, run: options.RunFolder = None) -> None:
    """Let a robot grasp the payload again, in the same place as before."""
    time = _set_holding(run, robot, holding=True)
    print(f"{robot} grasped the payload at {time:.2f} s")


def _set_holding(folder: Path | None, robot: str, *, holding: bool) -> float:
    """Send the request, and return the simulated time at which it took effect [s]."""
    from coheft.app.run.observer import ask_run
    from coheft.wire.messages.requests import HoldRequest

    return ask_run(HoldRequest(robot=robot, holding=holding), folder).time


@app.command(group=CONTROL)
def use(estimator: str | None = None, *, run: options.RunFolder = None) -> None:
    """Make all robots discard their estimates and start again with another estimator.

    Args:
        estimator: efficient, fan2017, or your own if the run started with it. Without one, print the estimator in use.
    """
    from coheft.app.run.observer import ask_run
    from coheft.wire.messages.requests import EstimatorRequest, StatusRequest
    from coheft.wire.scenario.plugins import estimator_names

    if estimator is None:
        status = ask_run(StatusRequest(), run)
        own, *beside = estimator_names(status.estimator)
        others = f", and beside it {', '.join(beside)}" if beside else ""
        print(f"the robots use {own}{others}; available: {', '.join(status.estimators)}")
    else:
        status = ask_run(EstimatorRequest(estimator=estimator), run)
        print(f"the robots use {status.estimator} from {status.time:.2f} s on, and start again")


@app.command(group=CONTROL)
def pause(*, run: options.RunFolder = None) -> None:
    """Pause a run."""
    print(f"paused at {_set_paused(run, paused=True):.2f} s; 'coheft resume' continues")


@app.command(group=CONTROL)
def resume(*, run: options.RunFolder = None) -> None:
    """Resume a paused run."""
    print(f"resumed at {_set_paused(run, paused=False):.2f} s")


def _set_paused(folder: Path | None, *, paused: bool) -> float:
    from coheft.app.run.observer import ask_run
    from coheft.wire.messages.requests import PauseRequest

    return ask_run(PauseRequest(paused=paused), folder).time


@app.command(group=CONTROL)
def stop(*, list: options.Flag = False, run: options.RunFolder = None) -> None:
    """End a run now; the terminal that started it shows its report.

    Args:
        list: End none, but list your runs in progress.
    """
    if list:
        if run is not None:
            raise UsageError("--list lists all your runs in progress: leave out --run")
        _list_runs()
        return
    from coheft.app.run.folder import locate_run
    from coheft.app.run.observer import ask_server
    from coheft.wire.messages.requests import StopRequest

    folder, run_file = locate_run(run, acts=True)
    status = ask_server(run_file, StopRequest())
    print(f"stopped {status.scenario} ({folder}) at {status.time:.2f} s")


def _list_runs() -> None:
    from rich.console import Console

    from coheft.app.run.folder import runs_folder, runs_in_progress
    from coheft.app.run.observer import ask_server
    from coheft.app.terminal.digits import seconds_of
    from coheft.app.terminal.wide_table import bare_table, print_table
    from coheft.wire.messages.requests import RunState, StatusRequest

    found = runs_in_progress()
    if not found:
        print("no run is in progress")
        return
    table = bare_table("Runs in progress", gap=1)
    for heading in ("run", "scenario", "since", "simulated"):
        table.add_column(heading, no_wrap=True)
    for place, run_file in found:
        since = strftime("%m-%d %H:%M", localtime(run_file.began))
        try:
            status = ask_server(run_file, StatusRequest())
        except LinkError:
            table.add_row(place.name, "", since, "does not answer")
            continue
        except CoheftError:  # it is of another release, or its keys are not there
            table.add_row(place.name, "", since, "cannot be asked")
            continue
        paused = ", paused" * (status.state is RunState.PAUSED)
        table.add_row(place.name, status.scenario, since, f"{seconds_of(status.time, status.duration)}{paused}")
    console = Console()
    print_table(console, table)
    for line in ("To end one: coheft stop --run RUN", f"Their folders are in {runs_folder()}"):
        console.print(line, markup=False, highlight=False, soft_wrap=True)


@app.command(group=CONTROL)
def watch(*, run: options.ShownRun = None) -> None:
    """Watch a run in progress until it ends."""
    from rich.console import Console

    from coheft.app.run.folder import locate_run
    from coheft.app.run.launch import watch as watch_run
    from coheft.app.terminal.screen import make_display

    print(watch_run(*locate_run(run), make_display(Console())))


@app.command(group=CONTROL)
def cut(one: Robot, other: Neighbour, *, run: options.RunFolder = None) -> None:
    """Cut the link between two neighbours: neither receives the other's messages any more.

    An agent that restarts connects to all its neighbours again, cut links included.
    """
    _set_link(run, one, other, cut=True)
    print(f"{one} and {other} no longer receive each other's messages; 'coheft mend {one} {other}' restores the link")


@app.command(group=CONTROL)
def mend(one: Robot, other: Neighbour, *, run: options.RunFolder = None) -> None:
    """Restore a link that was cut."""
    _set_link(run, one, other, cut=False)
    print(f"{one} and {other} can receive each other's messages again")


@app.command(group=CONTROL)
def disturb(
    robot: Robot,
    neighbour: Annotated[str | None, Parameter(help="One of its neighbours; without it, all of them.")] = None,
    *,
    loss: Share = 0.0,
    delay: Share = 0.0,
    jitter: Share = 0.0,
    clock: Share | None = None,
    run: options.RunFolder = None,
) -> None:
    """Lose or delay messages between neighbours, or set a robot's clock; without options, restore them.

    An agent that restarts is no longer disturbed.

    Args:
        loss: Share of messages that are lost, from 0 to 1.
        delay: Delay of every message [s], at most 1.
        jitter: Largest additional delay [s], drawn for each message, at most 1.
        clock: How far the clock of ROBOT is ahead [s], at most 1: its samples are that much older than their stamps.
    """
    from coheft.app.run.folder import find_run
    from coheft.app.run.observer import ask_server, disturb_links
    from coheft.wire.messages.requests import ClockRequest, StatusRequest
    from coheft.wire.scenario.network import LinkQuality

    quality = LinkQuality(loss=loss, delay=delay, jitter=jitter)
    if neighbour is not None and clock is not None:
        raise UsageError(f"a clock is one robot's: leave out {neighbour}, or --clock")
    run_file = find_run(run, acts=True)
    back = f"'coheft disturb {' '.join(filter(None, (robot, neighbour)))}' restores"
    if neighbour is None and (clock is not None or quality.is_ideal):
        ask_server(run_file, ClockRequest(robot=robot, ahead=clock or 0.0))
        print(
            f"the clock of {robot} is {clock:g} s ahead; {back} it" if clock else f"the clock of {robot} is right again"
        )
    if clock is not None and quality.is_ideal:
        return
    scene = ask_server(run_file, StatusRequest()).scene
    disturb_links(run_file, scene, robot, neighbour, quality)
    ends = f"{robot} and {neighbour or 'its neighbours'}"
    if quality.is_ideal:
        print(f"{ends} receive each other's messages in time again")
    else:
        print(f"messages between {ends}: {quality.in_words}; {back} {'them' if neighbour is None else 'the link'}")


def _set_link(folder: Path | None, one: str, other: str, *, cut: bool) -> None:
    from coheft.app.run.folder import find_run
    from coheft.app.run.observer import ask_server, set_link
    from coheft.wire.messages.requests import StatusRequest

    run_file = find_run(folder, acts=True)
    set_link(run_file, ask_server(run_file, StatusRequest()).scene, one, other, cut=cut)
