"""An identified load, of a report or of a run in progress; loads that may not be used are refused with the reason."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np

from coheft.app.identify.report import IdentifyReport
from coheft.app.results.report import Report, chosen_estimator
from coheft.errors import CoheftError, UsageError
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.rigid_body.consistency import is_possible
from coheft.estimation.rigid_body.mass_properties import Inertia, unpack_symmetric
from coheft.wire.messages.requests import RunState, StatusRequest
from coheft.wire.messages.structs import Estimate, EstimateBeside, Validity
from coheft.wire.scenario.plugins import estimator_names

_ROUNDING = 1e-9
_PATIENCE = 5.0
"""Time to wait for an estimate of a robot [s]."""


@dataclass(frozen=True, eq=False)
class FoundLoad:
    """Mass properties of the whole load in one frame; ``CoheftError`` is raised if no body can have them.

    Attributes:
        mass_std: Standard deviation of the mass [kg].
        com_std: Standard deviation of the centre of mass, shape (3,) [m].
        tensor_std: Standard deviations of the entries of the inertia about the centre of mass, shape (3, 3) [kg·m²].
        robot: Robot in whose grasp frame the load was identified.
    """

    inertia: Inertia
    mass_std: float
    com_std: Array
    tensor_std: Array
    robot: str
    source: str
    remarks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        inertia = self.inertia
        if inertia.com.shape != (3,) or inertia.tensor.shape != (3, 3):
            raise CoheftError(f"{self.source}: expected 3 numbers for the centre of mass and 3 × 3 for the inertia")
        exists = inertia.mass > 0.0 and is_possible(inertia.barycentric(), -_ROUNDING)
        if not (exists and np.allclose(inertia.tensor, inertia.tensor.T)):
            raise CoheftError(
                f"{self.source}: no body can have the mass properties that {self.robot} tells: {inertia.mass:g} kg"
            )

    def seen_from(self, pose: Pose) -> FoundLoad:
        """Return the load in another frame, in which the grasp frame has an exactly known pose.

        Standard deviations are bounds there, because correlations are not known.
        """
        size = np.abs(pose.rotation)
        return replace(
            self,
            inertia=self.inertia.transported(pose),
            com_std=size @ self.com_std,
            tensor_std=size @ self.tensor_std @ size.T,
        )


def of_run(report: Report, robot: str | None, source: str, estimator: str | None) -> FoundLoad:
    """Return the load that a robot (None: the first) found in a run with an estimator (None: its own).

    It raises a ``CoheftError`` if there is no such robot or estimator, or if its estimate may not be used, with the
    reason.
    """
    is_choice = bool(report.beside)
    report = report.of_estimator(estimator)
    source = f"{source}, estimator {report.estimator}" if is_choice else source
    name = chosen_robot(robot, list(report.robots))
    found = report.robots[name]
    _check_status(name, found.status, found.reasons)
    mass, com, inertia = found.mass, found.com, found.inertia
    if None in (mass.estimate, com.estimate, inertia.estimate, mass.std, com.std, inertia.std):
        raise _not_known(name, found.not_observable)
    remarks = () if found.converged else (f"{name} does not call it good enough yet (state: {found.state})",)
    load = Inertia(float(mass.estimate or 0.0), np.array(com.estimate), np.array(inertia.estimate))
    return FoundLoad(load, float(mass.std or 0.0), np.array(com.std), np.array(inertia.std), name, source, remarks)


def of_estimate(estimate: Estimate, source: str) -> FoundLoad:
    """Return the load of an estimate in a run; raise ``CoheftError`` with the reason if it may not be used."""
    name, payload = estimate.robot, estimate.payload
    _check_status(name, estimate.status, estimate.reasons)
    if payload is None or payload.com is None or payload.tensor is None:
        raise _not_known(name, estimate.not_observable)
    std = np.sqrt(np.diagonal(payload.covariance))
    remarks = () if estimate.converged else (f"{name} does not call it good enough yet",)
    inertia = Inertia(payload.mass, payload.com, payload.tensor)
    return FoundLoad(inertia, float(std[0]), std[1:4], unpack_symmetric(std[4:]), name, source, remarks)


def of_recording(report: IdentifyReport, robot: str | None, source: str) -> FoundLoad:
    """Return the load identified from a recording, in the grasp frame of its first robot.

    It raises a ``CoheftError`` if another robot is requested, or if the result may not be used, with the reason.
    """
    first = report.robots[0]
    if robot not in (None, first):
        raise CoheftError(
            f"{source} tells the load in the grasp frame of {first} only, but that of {robot} is asked for: leave "
            f"--robot out, and say with --flange where the grasp frame of {first} is"
        )
    if report.doubts or (report.verdict is not None and report.verdict.refuted):
        reasons = "; ".join(report.doubts) or "forces are not those of one rigid body"
        raise CoheftError(f"nothing of {source} is to be used: {reasons}")
    load = report.payload
    mass, com, inertia = load.mass_kg, load.com_m, load.inertia
    if mass is None or load.mass_std_kg is None or com is None or load.com_std_m is None or inertia is None:
        raise _not_known(first, report.not_observable)
    std = np.sqrt(np.diagonal(np.array(load.covariance)))
    possible = "what was solved for is no body that can exist; this is the most likely one that is"
    unjudged = () if report.not_judged is None else (f"not judged: {report.not_judged}",)
    remarks = (*(() if load.was_possible else (possible,)), *unjudged, *report.remarks)
    found = Inertia(mass, np.array(com), np.array(inertia))
    com_std, tensor_std = np.array(load.com_std_m), unpack_symmetric(std[4:])
    return FoundLoad(found, load.mass_std_kg, com_std, tensor_std, first, source, remarks)


def chosen_robot(robot: str | None, names: list[str]) -> str:
    """Return the robot, by default the first; raise ``CoheftError`` if there is no such robot."""
    name = names[0] if robot is None else robot
    if name not in names:
        raise CoheftError(f"there is no robot {name}: the robots are {', '.join(names)}")
    return name


def _check_status(robot: str, status: Validity, reasons: list[str]) -> None:
    if status is not Validity.VALID:
        raise CoheftError(
            f"the estimate of {robot} is {status}, not valid, and is not exported: "
            f"{'; '.join(reasons) or 'it has not found the load yet'}"
        )


def _not_known(robot: str, not_observable: list[str]) -> CoheftError:
    missing = "; ".join(not_observable) or "not all of mass, centre of mass and inertia is known yet"
    return CoheftError(f"{robot} does not know all of the load, and a part of it is not exported: {missing}")


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
