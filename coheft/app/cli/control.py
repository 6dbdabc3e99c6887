"""Commands for a run in progress."""

from __future__ import annotations

from pathlib import Path

from coheft.app.cli.base import CONTROL, RunFolder, Vector, Whole, app


@app.command(group=CONTROL)
def inject(*, mass: float, at: Vector, size: Vector = (0.1, 0.1, 0.1), run: RunFolder = None) -> None:
    """Drop a load onto the payload of a run in progress.

    Parameters
    ----------
    mass:
        Mass of the load [kg].
    at:
        Position of its centre, in the payload's frame [m].
    size:
        Its edge lengths [m].
    """
    from coheft.app.run.observer import ask_run
    from coheft.wire.messages.requests import InjectRequest

    status = ask_run(InjectRequest(mass=mass, position=at, size=size), run)
    print(f"load {status.loads[-1].id} of {mass:g} kg is on the payload; {status.slots_free} more fit")


@app.command(group=CONTROL)
def remove(load: Whole, *, run: RunFolder = None) -> None:
    """Take a load off the payload of a run in progress.

    Parameters
    ----------
    load:
        Number of the load, as printed by 'coheft inject'; loads are numbered from 1 in order of arrival.
    """
    from coheft.app.run.observer import ask_run
    from coheft.wire.messages.requests import RemoveRequest

    status = ask_run(RemoveRequest(load=load), run)
    print(f"load {load} taken away; {len(status.loads)} left")


@app.command(group=CONTROL)
def release(robot: str, *, run: RunFolder = None) -> None:
    """Let a robot let go of the payload.

    Parameters
    ----------
    robot:
        Its name.
    """
    time = _set_holding(run, robot, holding=False)
    print(f"{robot} let go at {time:.2f} s; 'coheft grasp {robot}' makes it grasp again")


@app.command(group=CONTROL)
def grasp(robot: str, *, run: RunFolder = None) -> None:
    """Let a robot grasp the payload again, in the same place as before.

    Parameters
    ----------
    robot:
        Its name.
    """
    time = _set_holding(run, robot, holding=True)
    print(f"{robot} took hold at {time:.2f} s")


def _set_holding(folder: Path | None, robot: str, *, holding: bool) -> float:
    """Simulated time when it was done [s]."""
    from coheft.app.run.observer import ask_run
    from coheft.wire.messages.requests import HoldRequest

    return ask_run(HoldRequest(robot=robot, holding=holding), folder).time


@app.command(group=CONTROL)
def use(estimator: str | None = None, *, run: RunFolder = None) -> None:
    """Make all robots discard their estimates and start again with another estimator.

    Parameters
    ----------
    estimator:
        efficient, fan2017, or your own if the run started with it. Without one, print the estimator in use.
    """
    from coheft.app.run.observer import ask_run
    from coheft.wire.messages.requests import EstimatorRequest, StatusRequest

    if estimator is None:
        status = ask_run(StatusRequest(), run)
        print(f"the robots use {status.estimator}; available: {', '.join(status.estimators)}")
    else:
        status = ask_run(EstimatorRequest(estimator=estimator), run)
        print(f"the robots use {status.estimator} from {status.time:.2f} s on, and start again")


@app.command(group=CONTROL)
def pause(*, run: RunFolder = None) -> None:
    """Pause a run."""
    from coheft.app.run.observer import ask_run
    from coheft.wire.messages.requests import PauseRequest

    status = ask_run(PauseRequest(paused=True), run)
    print(f"paused at {status.time:.2f} s; 'coheft resume' continues")


@app.command(group=CONTROL)
def resume(*, run: RunFolder = None) -> None:
    """Resume a paused run."""
    from coheft.app.run.observer import ask_run
    from coheft.wire.messages.requests import PauseRequest

    status = ask_run(PauseRequest(paused=False), run)
    print(f"resumed at {status.time:.2f} s")


@app.command(group=CONTROL)
def stop(*, run: RunFolder = None) -> None:
    """End a run now; the terminal that started it shows its report."""
    from coheft.app.run.folder import locate_run
    from coheft.app.run.observer import ask_server
    from coheft.wire.messages.requests import StopRequest

    folder, run_file = locate_run(run, acts=True)
    status = ask_server(run_file, StopRequest())
    print(f"stopped {status.scenario} ({folder}) at {status.time:.2f} s")


@app.command(group=CONTROL)
def watch(*, run: RunFolder = None) -> None:
    """Watch a run in progress until it ends."""
    from rich.console import Console

    from coheft.app.run.folder import find_run
    from coheft.app.run.launch import watch as watch_run
    from coheft.app.terminal.screen import make_display

    print(watch_run(find_run(run), make_display(Console())))


@app.command(group=CONTROL)
def cut(one: str, other: str, *, run: RunFolder = None) -> None:
    """Cut the link between two neighbours: neither receives the other's messages any more.

    An agent that restarts connects to all its neighbours again, cut links included.

    Parameters
    ----------
    one:
        A robot, for instance r1.
    other:
        Its neighbour.
    """
    _set_link(run, one, other, cut=True)
    print(f"{one} and {other} no longer receive each other's messages; 'coheft mend {one} {other}' restores the link")


@app.command(group=CONTROL)
def mend(one: str, other: str, *, run: RunFolder = None) -> None:
    """Mend a link that was cut.

    Parameters
    ----------
    one:
        A robot, for instance r1.
    other:
        Its neighbour.
    """
    _set_link(run, one, other, cut=False)
    print(f"{one} and {other} can receive each other's messages again")


def _set_link(folder: Path | None, one: str, other: str, *, cut: bool) -> None:
    from coheft.app.run.folder import find_run
    from coheft.app.run.observer import ask_server, set_link
    from coheft.wire.messages.requests import StatusRequest

    run_file = find_run(folder, acts=True)
    set_link(run_file, ask_server(run_file, StatusRequest()).scene, one, other, cut=cut)
