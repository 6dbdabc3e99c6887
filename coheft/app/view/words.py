"""The panel's texts and tables, as HTML. Whatever came from elsewhere is escaped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from coheft.app.results.judge import RobotReport
from coheft.app.results.states import State
from coheft.app.view.colours import ACCENT, STATUS, WAITING, Colour, css
from coheft.app.view.model import ViewModel
from coheft.wire.messages.requests import Status
from coheft.wire.messages.structs import Estimate, LoadState

_STYLE = "font-size:13px;line-height:1.45;padding:2px 10px 4px 10px;font-variant-numeric:tabular-nums"
_DIM = "opacity:.62"
_STATES = {"waiting": WAITING, "running": STATUS["valid"], "paused": (251, 191, 36), "finished": ACCENT}
_MEANING = {
    "starting": "still finding out",
    "valid": "holds, within its own bounds",
    "stale": "cannot know whether it still holds",
}
_PROBLEMS = 4
ENDED = "the run has ended; this is its last picture"
READ_ONLY = "This view shows the run, and cannot act: it was started so."
NO_OPERATOR = "This view shows the run, and cannot act: there are no keys of an operator."


def header(model: ViewModel, note: str = "") -> str:
    """What runs, how far it is."""
    status = model.status
    share = min(1.0, model.time / status.duration) if status.duration > 0.0 else 0.0
    truth = f"true mass <b>{model.truth.payload.mass:.3f} kg</b>" if model.truth is not None else "nothing heard yet"
    bar = (
        f'<div style="height:4px;border-radius:2px;background:rgba(148,163,184,.25);margin:7px 0 6px">'
        f'<div style="height:4px;border-radius:2px;width:{100.0 * share:.1f}%;background:{css(ACCENT)}"></div></div>'
    )
    speed = f" · {status.real_time_factor:.2g} × real time" if status.real_time_factor > 0.0 else ""
    return _page(
        f'<div style="display:flex;justify-content:space-between;align-items:center">'
        f'<span><span style="font-size:17px;font-weight:650">{escape(status.scenario)}</span>'
        f'<span style="{_DIM}"> · estimator {escape(model.estimator)}</span></span>'
        f"{_chip(status.state, _STATES[status.state])}</div>{bar}"
        f'<div style="display:flex;justify-content:space-between"><span>{model.time:.1f} of {status.duration:g} s'
        f'<span style="{_DIM}">{speed}</span></span><span>{truth}</span></div>'
        + (f'<div style="color:{css(_STATES["paused"])}">{escape(note)}</div>' if note else "")
    )


def waiting_note(status: Status, *, is_still: bool) -> str:
    """Why time stands still, if it does: a moment ago somebody is always waited for."""
    if status.state == "finished":
        return ENDED
    if status.state == "paused":
        return "paused: Resume goes on"
    return f"waiting for {', '.join(status.waiting_for)}" if status.waiting_for and is_still else ""


def load(state: LoadState) -> str:
    """Which load it is, and how heavy now."""
    return f"#{state.id} of {state.mass:.1f} kg"


def loads(states: Iterable[LoadState]) -> str:
    """All loads in one line."""
    return small(" · ".join(map(load, states)))


def small(text: str) -> str:
    """A line below a button or a list."""
    return f'<div style="font-size:12px;padding:0 10px;opacity:.7">{text}</div>'


def belief(report: RobotReport | None, estimate: Estimate | None) -> str:
    """What one robot believes, beside the truth: the numbers of the run's report."""
    if report is None or estimate is None:
        return _page(f'<div style="{_DIM}">This robot has not said anything yet.</div>')
    mass, com, inertia = report.mass, report.com, report.inertia
    rows = [_row("mass", "kg", [mass.truth], _list(mass.estimate), _list(mass.std), 3)]
    rows += _rows("centre of mass", "mm", "xyz", com.truth, com.estimate, com.std, 1e3, 1)
    diagonal = [[m[i][i] for i in range(3)] if m is not None else None for m in _matrices(report)]
    rows += _rows("inertia", "kg·m²", ["xx", "yy", "zz"], diagonal[0] or [], diagonal[1], diagonal[2], 1.0, 3)
    table = (
        f'<table style="width:100%;border-collapse:collapse"><tr style="{_DIM}"><td></td><td></td>'
        f"{_right('truth')}{_right('estimate')}{_right('± std')}</tr>{''.join(rows)}</table>"
    )
    errors = [
        f"mass {mass.error_pct:.2f} %" if mass.error_pct is not None else "",
        f"centre {com.error_mm:.1f} mm" if com.error_mm is not None else "",
        f"inertia {inertia.error_pct:.1f} %" if inertia.error_pct is not None else "",
    ]
    off = " · ".join(error for error in errors if error)
    lines = [f'<div style="margin-top:5px"><span style="{_DIM}">off by</span> {off}</div>'] if off else []
    lines += [_bullet(text, STATUS[report.status]) for text in report.reasons]
    lines += [_bullet(f"cannot tell {text}", WAITING) for text in report.not_observable if text not in report.reasons]
    noticed = [f"{notice.noticed_at:.2f} s" for notice in estimate.load_changes]
    if noticed:
        lines.append(f'<div><span style="{_DIM}">noticed load changes at</span> {", ".join(noticed[-4:])}</div>')
    named = [f"{slip.robot} at {slip.named_at:.2f} s" for slip in estimate.slips]
    if named:
        lines.append(f'<div><span style="{_DIM}">found grasps that slipped:</span> {", ".join(named[-4:])}</div>')
    head = (
        f'<div style="display:flex;gap:8px;align-items:center;margin-bottom:3px">'
        f"{_chip(report.status, STATUS[report.status])}"
        f'<span style="{_DIM}">{_MEANING[report.status]}'
        f"{', converged' if report.is_converged else ''}</span></div>"
    )
    return _page(head + table + "".join(lines))


def team(model: ViewModel, chosen: str) -> str:
    """All robots in a line each."""
    beliefs = model.beliefs
    rows = []
    for name in model.scene.robots:
        estimate = beliefs.get(name)
        status = estimate.status if estimate is not None else "starting"
        payload = estimate.payload if estimate is not None else None
        mass = f"{payload.mass:.3f}" if payload is not None else "–"
        std = f"{payload.covariance[0, 0] ** 0.5:.3f}" if payload is not None else ""
        colour = f"color:{css(ACCENT)};font-weight:650" if name == chosen else ""
        rows.append(
            f'<tr><td style="width:16px">{_dot(STATUS[status])}</td><td style="{colour}">{escape(name)}</td>'
            f'<td style="{_DIM}">{"" if estimate is None else State.of(estimate)}</td>'
            f"{_right(mass)}{_right(f'± {std}' if std else '', dim=True)}</tr>"
        )
    return _page(f'<table style="width:100%;border-collapse:collapse">{"".join(rows)}</table>')


def problems(model: ViewModel) -> str:
    """What went wrong lately."""
    newest = list(model.problems)[-_PROBLEMS:]
    if not newest:
        return _page(f'<div style="{_DIM}">Nothing was refused, no one is missing.</div>')
    return _page(
        "".join(
            f'<div style="margin-bottom:3px"><span style="{_DIM}">{time:.1f} s {escape(problem.source)}</span> '
            f"{escape(problem.text)}</div>"
            for time, problem in reversed(newest)
        )
    )


def legend(doubt_scale: float) -> str:
    """What the colours mean."""
    return _page(
        f'<div style="font-size:12px;{_DIM}">White: the truth. Blue: what the chosen robot believes; box: a body of '
        f"that inertia; ellipsoid: where the centre of mass is within 3σ, {doubt_scale:g} × as large. Yellow, violet: "
        f"forces and torques. Lines below: who hears whom.</div>"
    )


def _rows(
    name: str,
    unit: str,
    axes: Iterable[str],
    truth: Sequence[float],
    estimate: Sequence[float] | None,
    std: Sequence[float] | None,
    scale: float,
    digits: int,
) -> list[str]:
    result = []
    for index, axis in enumerate(axes):
        cells = [[scale * values[index]] if values is not None else [] for values in (truth, estimate, std)]
        result.append(_row(name if index == 0 else "", f"{axis} {unit}", cells[0], cells[1], cells[2], digits))
    return result


def _row(
    name: str, unit: str, truth: Sequence[float], estimate: Sequence[float], std: Sequence[float], digits: int
) -> str:
    cells = [_right("".join(f"{value:.{digits}f}" for value in values) or "–") for values in (truth, estimate, std)]
    return f'<tr><td>{name}</td><td style="{_DIM}">{unit}</td>{"".join(cells)}</tr>'


def _matrices(report: RobotReport) -> list[list[list[float]] | None]:
    return [report.inertia.truth, report.inertia.estimate, report.inertia.std]


def _list(value: float | None) -> list[float]:
    return [] if value is None else [value]


def _right(text: str, *, dim: bool = False) -> str:
    return f'<td style="text-align:right;{_DIM if dim else ""}">{text}</td>'


def _chip(text: str, colour: Colour) -> str:
    return (
        f'<span style="color:{css(colour)};border:1px solid {css(colour)};border-radius:9px;padding:0 8px;'
        f'font-size:12px;font-weight:600">{escape(text)}</span>'
    )


def _dot(colour: Colour) -> str:
    return f'<span style="display:inline-block;width:8px;height:8px;border-radius:4px;background:{css(colour)}"></span>'


def _bullet(text: str, colour: Colour) -> str:
    return f'<div style="color:{css(colour)}">{escape(text)}</div>'


def _page(text: str) -> str:
    return f'<div style="{_STYLE}">{text}</div>'
