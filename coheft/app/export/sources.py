"""Sources of identified loads: JSON reports, and runs in progress."""

import time
from pathlib import Path

import msgspec

from coheft.app.export.found_load import FoundLoad, chosen_robot, of_estimate, of_recording, of_run
from coheft.app.identify.report import IdentifyReport
from coheft.app.results.report import Report, chosen_estimator
from coheft.errors import CoheftError, UsageError
from coheft.wire.messages.requests import RunState

_PATIENCE = 5.0
"""Time to wait for an estimate of a robot [s]."""


def read_load(path: Path, robot: str | None, estimator: str | None) -> FoundLoad:
    """Return the load of a report of ``coheft run`` or ``coheft identify``; choices and errors as of ``of_run``."""
    try:
        text = path.read_bytes()
        keys = msgspec.json.decode(text, type=dict[str, msgspec.Raw])
        if "recording" in keys:
            refuse_estimator(estimator, str(path))
            return of_recording(msgspec.json.decode(text, type=IdentifyReport), robot, str(path))
        return of_run(msgspec.json.decode(text, type=Report), robot, str(path), estimator)
    except OSError as error:
        raise CoheftError(f"{path}: cannot be read: {error.strerror}") from error
    except msgspec.MsgspecError as error:
        raise CoheftError(
            f"{path}: expected a report of 'coheft run --json' or 'coheft identify --json'; found something else: "
            f"{error}. A recording has to be identified first: coheft identify {path} --json report.json"
        ) from error


def refuse_estimator(estimator: str | None, source: str) -> None:
    """Raise a ``UsageError`` if an estimator is chosen for a load that was identified from a recording."""
    if estimator is not None:
        raise UsageError(
            f"--estimator chooses between estimators of a run, but {source} is of a recording: leave it out"
        )


def load_of_run(folder: Path | None, robot: str | None, estimator: str | None) -> FoundLoad:
    """Return the load that a robot of a run in progress, by default the newest, reports now.

    Choices and errors are as of ``of_run``; it is also an error if the robot sends no estimate.
    """
    from coheft.app.run.folder import locate_run
    from coheft.app.run.observer import observe
    from coheft.wire.messages.requests import StatusRequest
    from coheft.wire.messages.structs import Estimate, EstimateBeside
    from coheft.wire.scenario.plugins import estimator_names

    place, run_file = locate_run(folder)
    with observe(run_file) as observer:
        status = observer.ask(StatusRequest())
        name = chosen_robot(robot, status.scene.robots)
        names = estimator_names(status.estimator)
        chosen = chosen_estimator(estimator, names)
        of_chosen = f", estimator {chosen}" if len(names) > 1 else ""
        deadline = time.monotonic() + _PATIENCE
        while time.monotonic() < deadline:
            for news in observer.collect(status.scene, 0.1):
                heard = news.estimate if isinstance(news, EstimateBeside) else news
                if isinstance(heard, Estimate) and (heard.robot, heard.estimator) == (name, chosen):
                    source = f"the run {status.scenario} ({place.name}) at {heard.time:g} s{of_chosen}"
                    return of_estimate(heard, source)
    state = f"the run is {status.state}" if status.state is not RunState.RUNNING else "its agent may have stopped"
    raise CoheftError(f"{name} has said nothing for {_PATIENCE:g} s: {state}")
