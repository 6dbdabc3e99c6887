"""Where loads that were found are: JSON reports, and runs that go on."""

from __future__ import annotations

import time
from pathlib import Path

import msgspec

from coheft.app.export.found_load import FoundLoad, of_estimate, of_recording, of_run
from coheft.app.identify.report import IdentifyReport
from coheft.app.results.report import Report
from coheft.errors import CoheftError

_PATIENCE = 5.0
"""A robot that says nothing for so long says nothing [s]."""


def read_load(path: Path, robot: str | None) -> FoundLoad:
    """The load of a JSON report of ``coheft run`` or ``coheft identify``.

    Args:
        path: Of the report.
        robot: Whose estimate; None: the first one's.

    Raises:
        CoheftError: It is no such report, or what it tells is not to be used; says why.
    """
    try:
        text = path.read_bytes()
        keys = msgspec.json.decode(text, type=dict[str, msgspec.Raw])
        if "recording" in keys:
            return of_recording(msgspec.json.decode(text, type=IdentifyReport), robot, str(path))
        return of_run(msgspec.json.decode(text, type=Report), robot, str(path))
    except OSError as error:
        raise CoheftError(f"{path}: cannot be read: {error.strerror}") from error
    except msgspec.MsgspecError as error:
        raise CoheftError(
            f"{path}: expected a report of 'coheft run --json' or 'coheft identify --json'; found something else: "
            f"{error}. A recording has to be identified first: coheft identify {path} --json report.json"
        ) from error


def hear_load(folder: Path | None, robot: str | None) -> FoundLoad:
    """The load as a robot of a run that goes on tells it now.

    Args:
        folder: Of the run; None: the newest.
        robot: Whose estimate; None: the first one's.

    Raises:
        CoheftError: There is no such run or robot, or it says nothing, or what it says is not to be used; says why.
    """
    from coheft.app.run.folder import locate_run
    from coheft.app.run.observer import observe
    from coheft.wire.messages.requests import StatusRequest
    from coheft.wire.messages.structs import Estimate

    place, run_file = locate_run(folder)
    with observe(run_file) as observer:
        status = observer.ask(StatusRequest())
        names = status.scene.robots
        name = names[0] if robot is None else robot
        if name not in names:
            raise CoheftError(f"there is no robot {name}: the robots are {', '.join(names)}")
        deadline = time.monotonic() + _PATIENCE
        while time.monotonic() < deadline:
            for news in observer.collect(status.scene, 0.1):
                if isinstance(news, Estimate) and news.robot == name:
                    return of_estimate(news, f"the run {status.scenario} ({place.name}) at {news.time:g} s")
    state = f"the run is {status.state}" if status.state != "running" else "its agent may have stopped"
    raise CoheftError(f"{name} has said nothing for {_PATIENCE:g} s: {state}")
