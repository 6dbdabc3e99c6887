"""Texts and tables of the panel; ``panel.html.jinja`` lays them out, and escapes texts from other processes."""

from collections.abc import Iterable, Sequence
from functools import cache
from typing import Any

from coheft.app.names import few
from coheft.app.results.judge import RobotReport
from coheft.app.results.states import MEANINGS, State
from coheft.app.templates import templates_beside
from coheft.app.terminal.digits import decimals_for, seconds_of, significant, std_text, value_and_std
from coheft.app.view import colours
from coheft.app.view.model import ViewModel
from coheft.wire.messages.requests import RunState, Status
from coheft.wire.messages.structs import Estimate, Validity
from coheft.wire.messages.truth import LoadState
from coheft.wire.scenario.schema import MAX_DURATION

_Row = tuple[str, ...]
"""Name, unit, truth, estimate and its standard deviation."""
_PROBLEMS = 4
_MOST_DECIMALS = 6
ENDED = "the run has ended; this is how it ended"
READ_ONLY = "This view is read-only: it was started that way."
NO_OPERATOR = "This view is read-only: it has no operator's keys."


@cache
def _template() -> Any:
    environment = templates_beside(__file__)
    environment.filters["css"] = colours.css
    environment.globals["colours"] = colours
    return environment.get_template("panel.html.jinja").module


def _filled(part: str, *values: object) -> str:
    return str(getattr(_template(), part)(*values))


def header(model: ViewModel, note: str = "") -> str:
    """Return the header: name, time and state of the run."""
    duration, record = model.status.duration, model.record
    share = min(1.0, record.time / duration) if 0.0 < duration < MAX_DURATION else None
    return _filled("header", model, share, seconds_of(record.time, duration), record.truth, note)


def waiting_note(status: Status, *, is_still: bool) -> str:
    """Return why the run does not advance; empty if it does, or waits only briefly."""
    if status.state is RunState.FINISHED:
        return ENDED
    if status.state is RunState.PAUSED:
        return "paused: press Resume to continue"
    return f"waiting for {few(status.waiting_for)}" if status.waiting_for and is_still else ""


def load(state: LoadState) -> str:
    """Describe a load."""
    return f"#{state.id} of {state.mass:.1f} kg"


def loads(states: Iterable[LoadState]) -> str:
    """Describe all loads in one line."""
    return small(" · ".join(map(load, states)))


def disturbances(model: ViewModel) -> str:
    """List the links and clocks that are disturbed; a link once if it is in both directions alike."""
    found, lines = model.disturbances, []
    for one, other in model.edges:
        there, back = found.get((one, other), ""), found.get((other, one), "")
        if there and there == back:
            lines.append(f"{one}-{other}: {there}")
            continue
        lines += [f"{a} to {b}: {what}" for a, b, what in ((one, other, there), (other, one, back)) if what]
    lines += [f"clock of {robot}: {found[robot,]}" for robot in model.scene.robots if (robot,) in found]
    return _filled("disturbances", lines)


def small(text: str) -> str:
    """Return a line below a button or a list."""
    return _filled("small", text)


def beliefs(model: ViewModel, robot: str) -> str:
    """One robot's estimate, and below it those of the estimators that run beside its own."""
    reports = model.reports(robot)
    return "".join((small(name) if len(reports) > 1 else "") + belief(found) for name, found in reports.items())


def belief(found: tuple[RobotReport, Estimate] | None) -> str:
    """Return a table of one robot's estimate and the truth, with the numbers of the run's report."""
    if found is None:
        return _filled("belief", None)
    report, estimate = found
    mass, com, inertia = report.mass, report.com, report.inertia
    masses = [None if value is None else [value] for value in (mass.truth, mass.estimate, mass.std)]
    matrices = (inertia.truth, inertia.estimate, inertia.std)
    diagonals = [None if m is None else [m[i][i] for i in range(3)] for m in matrices]
    rows = _rows("mass", "kg", [""], masses, 1.0, 3)
    rows += _rows("centre of mass", "mm", "xyz", (com.truth, com.estimate, com.std), 1e3, 1)
    rows += _rows("inertia", "kg·m²", ["xx", "yy", "zz"], diagonals, 1.0, 3)
    off = [
        f"{name} {significant(error, 2) if error >= 0.01 else 'below 0.01'} {unit}"
        for name, error, unit in (
            ("mass", mass.error_pct, "%"),
            ("centre of mass", com.error_mm, "mm"),
            ("inertia", inertia.error_pct, "%"),
        )
        if error is not None
    ]
    noticed = [f"{notice.noticed_at:.2f} s" for notice in estimate.load_changes]
    slipped = [f"{slip.robot} at {slip.named_at:.2f} s" for slip in estimate.slips]
    return _filled("belief", report, MEANINGS[report.state], rows, off, noticed, slipped)


def team(model: ViewModel, chosen: str) -> str:
    """Return a table with a line for each robot."""
    robots, beliefs = [], model.record.beliefs
    for name in model.scene.robots:
        estimate = beliefs.get(name)
        payload = estimate.payload if estimate is not None else None
        known = value_and_std(payload.mass, payload.covariance[0, 0] ** 0.5, 2) if payload is not None else "–"
        mass, _, std = known.partition(" ± ")
        status, state = (Validity.STARTING, "") if estimate is None else (estimate.status, State.of(estimate))
        robots.append((name, status, state, mass, std))
    return _filled("team", robots, chosen)


def problems(model: ViewModel) -> str:
    """Return the latest problems."""
    return _filled("problems", list(model.problems)[: -_PROBLEMS - 1 : -1])


def legend(doubt_scale: float) -> str:
    """Return the legend of the scene and of the curves."""
    return _filled("legend", doubt_scale)


def _rows(
    name: str, unit: str, axes: Iterable[str], found: Sequence[Sequence[float] | None], scale: float, digits: int
) -> list[_Row]:
    """Return a row for each axis of a quantity; ``found`` has truth, estimate and standard deviation."""
    result = []
    for index, axis in enumerate(axes):
        truth, estimate, std = (None if values is None else scale * values[index] for values in found)
        needed = digits if std is None else decimals_for(std, 2, at_least=digits)
        decimals = min(needed, _MOST_DECIMALS)
        numbers = ("–" if value is None else f"{value:.{decimals}f}" for value in (truth, estimate))
        std_cell = "–" if std is None else std_text(std, needed)
        result.append((name if index == 0 else "", f"{axis} {unit}".strip(), *numbers, std_cell))
    return result
