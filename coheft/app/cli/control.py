"""Commands for a run that goes on."""

from __future__ import annotations

from pathlib import Path

from coheft.app.cli.base import CONTROL, RunFolder, Vector, Whole, app


@app.command(group=CONTROL)
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
    """
    from coheft.app.run.observer import ask_run
    from coheft.wire.messages.requests import InjectRequest

    status = ask_run(InjectRequest(mass=mass, position=at, size=size), run)
    print(f"load {status.loads[-1].id} of {mass:g} kg put on; {status.slots_free} more fit")


@app.command(group=CONTROL)
def remove(load: Whole, *, run: RunFolder = None) -> None:
    """Take a load off the payload of a run that goes on.

    Parameters
    ----------
    load:
        Its number, as 'coheft inject' told; loads are numbered from 1 as they come.
    """
    from coheft.app.run.observer import ask_run
    from coheft.wire.messages.requests import RemoveRequest

    status = ask_run(RemoveRequest(load=load), run)
    print(f"load {load} taken away; {len(status.loads)} left")


@app.command(group=CONTROL)
def release(robot: str, *, run: RunFolder = None) -> None:
    """Let a robot of a run take its hand off the payload.

    Parameters
    ----------
    robot:
        Its name.
    """
    time = _set_holding(run, robot, holding=False)
    print(f"{robot} let go at {time:.2f} s; 'coheft grasp {robot}' lets it take hold again")


@app.command(group=CONTROL)
def grasp(robot: str, *, run: RunFolder = None) -> None:
    """Let a robot of a run take hold of the payload again, where it held it before.

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
    """Let all robots of a run forget what they know and begin anew with another estimator.

    Parameters
    ----------
    estimator:
        efficient, fan2017, or your own if the run has begun with it; without one, tell which one is in use.
    """
    from coheft.app.run.observer import ask_run
    from coheft.wire.messages.requests import EstimatorRequest, StatusRequest

    if estimator is None:
        status = ask_run(StatusRequest(), run)
        print(f"the robots use {status.estimator}; there are: {', '.join(status.estimators)}")
    else:
        status = ask_run(EstimatorRequest(estimator=estimator), run)
        print(f"the robots use {status.estimator} from {status.time:.2f} s on, and begin anew")


@app.command(group=CONTROL)
def pause(*, run: RunFolder = None) -> None:
    """Stop the clock of a run."""
    from coheft.app.run.observer import ask_run
    from coheft.wire.messages.requests import PauseRequest

    status = ask_run(PauseRequest(paused=True), run)
    print(f"paused at {status.time:.2f} s; 'coheft resume' goes on")


@app.command(group=CONTROL)
def resume(*, run: RunFolder = None) -> None:
    """Let a paused run go on."""
    from coheft.app.run.observer import ask_run
    from coheft.wire.messages.requests import PauseRequest

    status = ask_run(PauseRequest(paused=False), run)
    print(f"goes on from {status.time:.2f} s")


@app.command(group=CONTROL)
def stop(*, run: RunFolder = None) -> None:
    """End a run now; whoever started it gets its report."""
    from coheft.app.run.folder import locate_run
    from coheft.app.run.observer import ask_server
    from coheft.wire.messages.requests import StopRequest

    folder, run_file = locate_run(run, acts=True)
    status = ask_server(run_file, StopRequest())
    print(f"stopped {status.scenario} ({folder}) at {status.time:.2f} s")


@app.command(group=CONTROL)
def watch(*, run: RunFolder = None) -> None:
    """Watch a run that goes on, until it ends."""
    from rich.console import Console

    from coheft.app.run.folder import find_run
    from coheft.app.run.launch import watch as watch_run
    from coheft.app.terminal.screen import make_display

    print(watch_run(find_run(run), make_display(Console())))


@app.command(group=CONTROL)
def cut(one: str, other: str, *, run: RunFolder = None) -> None:
    """Cut the link between two neighbours of a run that goes on: each falls silent to the other.

    If the agent that dials it starts again, it dials all its neighbours.

    Parameters
    ----------
    one:
        A robot, for instance r1.
    other:
        Its neighbour.
    """
    _set_link(run, one, other, cut=True)
    print(f"{one} and {other} do not hear each other any more; 'coheft mend {one} {other}' links them again")


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
    print(f"{one} and {other} may hear each other again")


def _set_link(folder: Path | None, one: str, other: str, *, cut: bool) -> None:
    from coheft.app.run.folder import find_run
    from coheft.app.run.observer import ask_server, set_link
    from coheft.wire.messages.requests import StatusRequest

    run_file = find_run(folder, acts=True)
    set_link(run_file, ask_server(run_file, StatusRequest()).scene, one, other, cut=cut)
