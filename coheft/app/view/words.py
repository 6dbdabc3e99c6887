"""The panel's texts and tables: ``panel.html.jinja`` lays them out, and escapes whatever came from elsewhere."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from coheft.app.results.judge import RobotReport
from coheft.app.results.states import MEANINGS, State
from coheft.app.terminal.digits import decimals_for, seconds_of, std_text, value_and_std
from coheft.app.view import colours
from coheft.app.view.model import ViewModel
from coheft.wire.messages.requests import Status
from coheft.wire.messages.structs import Estimate
from coheft.wire.messages.truth import LoadState
from coheft.wire.scenario.schema import MAX_DURATION

_Row = tuple[str, str, str, str, str]
"""Name, unit, truth, estimate and its standard deviation."""
_PROBLEMS = 4
_MOST_DECIMALS = 6
ENDED = "the run has ended; this is how it ended"
READ_ONLY = "This view is read-only: it was started that way."
NO_OPERATOR = "This view is read-only: it has no operator's keys."


@cache
def _template() -> Any:
    """The macros of the panel."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["css"] = colours.css
    environment.globals["colours"] = colours
    return environment.get_template("panel.html.jinja").module


def _filled(part: str, *values: object) -> str:
    """A part of the panel with what it shows."""
    return str(getattr(_template(), part)(*values))


def header(model: ViewModel, note: str = "") -> str:
    """What runs, how far it is."""
    duration = model.status.duration
    share = min(1.0, model.time / duration) if 0.0 < duration < MAX_DURATION else None
    return _filled("header", model, share, seconds_of(model.time, duration), model.truth, note)


def waiting_note(status: Status, *, is_still: bool) -> str:
    """Why time stands still, if it does; some robot is always waited for briefly."""
    if status.state == "finished":
        return ENDED
    if status.state == "paused":
        return "paused: press Resume to continue"
    return f"waiting for {', '.join(status.waiting_for)}" if status.waiting_for and is_still else ""


def load(state: LoadState) -> str:
    """Which load it is, and how heavy now."""
    return f"#{state.id} of {state.mass:.1f} kg"


def loads(states: Iterable[LoadState]) -> str:
    """All loads in one line."""
    return small(" · ".join(map(load, states)))


def small(text: str) -> str:
    """A line below a button or a list."""
    return _filled("small", text)


def beliefs(model: ViewModel, robot: str) -> str:
    """One robot's estimate, and below it those of the estimators that run beside its own."""
    each = [("", model), *model.beside.items()]
    return "".join(
        (small(name) if name else "") + belief(found.report(robot), found.beliefs.get(robot)) for name, found in each
    )


def belief(report: RobotReport | None, estimate: Estimate | None) -> str:
    """One robot's estimate beside the truth, with the numbers of the run's report."""
    if report is None or estimate is None:
        return _filled("belief", None)
    mass, com, inertia = report.mass, report.com, report.inertia
    rows = [_row("mass", "kg", [mass.truth], _list(mass.estimate), _list(mass.std), 3)]
    rows += _rows("centre of mass", "mm", "xyz", com.truth, com.estimate, com.std, 1e3, 1)
    matrices = (inertia.truth, inertia.estimate, inertia.std)
    diagonal = [[m[i][i] for i in range(3)] if m is not None else None for m in matrices]
    rows += _rows("inertia", "kg·m²", ["xx", "yy", "zz"], diagonal[0] or [], diagonal[1], diagonal[2], 1.0, 3)
    off = [
        f"{name} {_small_number(error)} {unit}"
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


def _small_number(value: float) -> str:
    return f"{value:.2g}" if value >= 0.01 else "below 0.01"


def team(model: ViewModel, chosen: str) -> str:
    """All robots in a line each."""
    robots = []
    for name in model.scene.robots:
        estimate = model.beliefs.get(name)
        payload = estimate.payload if estimate is not None else None
        known = value_and_std(payload.mass, payload.covariance[0, 0] ** 0.5, 2) if payload is not None else "–"
        mass, _, std = known.partition(" ± ")
        status, state = ("starting", "") if estimate is None else (estimate.status, State.of(estimate))
        robots.append((name, status, state, mass, std))
    return _filled("team", robots, chosen)


def problems(model: ViewModel) -> str:
    """What went wrong lately."""
    return _filled("problems", list(model.problems)[: -_PROBLEMS - 1 : -1])


def legend(doubt_scale: float) -> str:
    """What the colours mean, in the scene and in the curves."""
    return _filled("legend", doubt_scale)


def _rows(
    name: str,
    unit: str,
    axes: Iterable[str],
    truth: Sequence[float],
    estimate: Sequence[float] | None,
    std: Sequence[float] | None,
    scale: float,
    digits: int,
) -> list[_Row]:
    result = []
    for index, axis in enumerate(axes):
        cells = [[scale * values[index]] if values is not None else [] for values in (truth, estimate, std)]
        result.append(_row(name if index == 0 else "", f"{axis} {unit}", cells[0], cells[1], cells[2], digits))
    return result


def _row(
    name: str, unit: str, truth: Sequence[float], estimate: Sequence[float], std: Sequence[float], digits: int
) -> _Row:
    needed = max([digits, *(decimals_for(value, 2) for value in std)])
    decimals = min(needed, _MOST_DECIMALS)
    texts = ["".join(f"{value:.{decimals}f}" for value in values) for values in (truth, estimate)]
    std_cell = "".join(std_text(value, needed) for value in std)
    return name, unit, texts[0] or "–", texts[1] or "–", std_cell or "–"


def _list(value: float | None) -> list[float]:
    return [] if value is None else [value]
