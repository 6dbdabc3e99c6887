"""The panel's texts and tables, as HTML. Whatever came from elsewhere is escaped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from coheft.app.results.judge import RobotReport
from coheft.app.results.states import MEANINGS, State
from coheft.app.terminal.digits import decimals_for, seconds_of, std_text, value_and_std
from coheft.app.view.colours import ACCENT, BAD, FORCE, GOOD, STATUS, TORQUE, TRUTH, WAITING, Colour, css
from coheft.app.view.model import ViewModel
from coheft.wire.messages.requests import Status
from coheft.wire.messages.structs import Estimate, LoadState
from coheft.wire.scenario.schema import MAX_DURATION

_STYLE = "font-size:13px;line-height:1.45;padding:2px 10px 4px 10px;font-variant-numeric:tabular-nums"
_DIM = "opacity:.62"
_STATES = {"waiting": WAITING, "running": STATUS["valid"], "paused": (251, 191, 36), "finished": ACCENT}
_NARROW = (
    "<style>@media (max-width: 36em) {.numbers td {font-size: 10px; padding: 0 1px} "
    ".numbers td:nth-child(n+3) {padding-left: 5px}}</style>"
)
_PROBLEMS = 4
_MOST_DECIMALS = 6
ENDED = "the run has ended; this is how it ended"
READ_ONLY = "This view is read-only: it was started that way."
NO_OPERATOR = "This view is read-only: it has no operator's keys."


def header(model: ViewModel, note: str = "") -> str:
    """What runs, how far it is."""
    status = model.status
    has_end = 0.0 < status.duration < MAX_DURATION
    share = min(1.0, model.time / status.duration) if has_end else 0.0
    bar_height = 4 if has_end else 0
    truth = f"true mass <b>{model.truth.payload.mass:.3f} kg</b>" if model.truth is not None else "no data yet"
    bar = (
        f'<div style="height:{bar_height}px;border-radius:2px;background:rgba(148,163,184,.25);margin:7px 0 6px">'
        f'<div style="height:{bar_height}px;border-radius:2px;width:{100.0 * share:.1f}%;background:{css(ACCENT)}">'
        f"</div></div>"
    )
    speed = f" · {status.real_time_factor:.2g} × real time" if status.real_time_factor > 0.0 else ""
    return _page(
        f'<div style="display:flex;justify-content:space-between;align-items:center">'
        f'<span><span style="font-size:17px;font-weight:650">{escape(status.scenario)}</span>'
        f'<span style="{_DIM}"> · estimator {escape(model.estimator)}</span></span>'
        f"{_chip(status.state, _STATES[status.state])}</div>{bar}"
        f'<div style="display:flex;justify-content:space-between"><span>{seconds_of(model.time, status.duration)}'
        f'<span style="{_DIM}">{speed}</span></span><span>{truth}</span></div>'
        + (f'<div style="color:{css(_STATES["paused"])}">{escape(note)}</div>' if note else "")
    )


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
    return f'<div style="font-size:12px;padding:0 10px;opacity:.7">{text}</div>'


def belief(report: RobotReport | None, estimate: Estimate | None) -> str:
    """One robot's estimate beside the truth, with the numbers of the run's report."""
    if report is None or estimate is None:
        return _page(f'<div style="{_DIM}">No estimate from this robot yet.</div>')
    mass, com, inertia = report.mass, report.com, report.inertia
    rows = [_row("mass", "kg", [mass.truth], _list(mass.estimate), _list(mass.std), 3)]
    rows += _rows("centre of mass", "mm", "xyz", com.truth, com.estimate, com.std, 1e3, 1)
    diagonal = [[m[i][i] for i in range(3)] if m is not None else None for m in _matrices(report)]
    rows += _rows("inertia", "kg·m²", ["xx", "yy", "zz"], diagonal[0] or [], diagonal[1], diagonal[2], 1.0, 3)
    table = (
        f'{_NARROW}<table class="numbers" style="width:100%;border-collapse:collapse">'
        f'<tr style="{_DIM}"><td></td><td></td>'
        f"{_right('truth')}{_right('estimate')}{_right('± std')}</tr>{''.join(rows)}</table>"
    )
    errors = [
        f"mass {_small_number(mass.error_pct)} %" if mass.error_pct is not None else "",
        f"centre of mass {_small_number(com.error_mm)} mm" if com.error_mm is not None else "",
        f"inertia {_small_number(inertia.error_pct)} %" if inertia.error_pct is not None else "",
    ]
    off = " · ".join(error for error in errors if error)
    lines = [f'<div style="margin-top:5px"><span style="{_DIM}">off by</span> {off}</div>'] if off else []
    lines += [
        _bullet(f"further off than it claims: {each.quantity}, by {each.stds:.2g} own std", BAD)
        for each in report.contradictions
    ]
    lines += [_bullet(text, STATUS[report.status]) for text in report.reasons]
    lines += [
        _bullet(f"not observable: {text}", WAITING) for text in report.not_observable if text not in report.reasons
    ]
    noticed = [f"{notice.noticed_at:.2f} s" for notice in estimate.load_changes]
    if noticed:
        lines.append(f'<div><span style="{_DIM}">noticed load changes at</span> {", ".join(noticed[-4:])}</div>')
    named = [f"{slip.robot} at {slip.named_at:.2f} s" for slip in estimate.slips]
    if named:
        lines.append(f'<div><span style="{_DIM}">found grasps that slipped:</span> {", ".join(named[-4:])}</div>')
    head = (
        f'<div style="display:flex;gap:8px;align-items:center;margin-bottom:3px">'
        f"{_chip(report.state, BAD if report.contradictions else STATUS[report.status])}"
        f'<span style="{_DIM}">{MEANINGS[report.state]}</span></div>'
    )
    return _page(head + table + "".join(lines))


def _small_number(value: float) -> str:
    return f"{value:.2g}" if value >= 0.01 else "below 0.01"


def team(model: ViewModel, chosen: str) -> str:
    """All robots in a line each."""
    beliefs = model.beliefs
    rows = []
    for name in model.scene.robots:
        estimate = beliefs.get(name)
        status = estimate.status if estimate is not None else "starting"
        payload = estimate.payload if estimate is not None else None
        known = value_and_std(payload.mass, payload.covariance[0, 0] ** 0.5, 2) if payload is not None else "–"
        mass, _, std = known.partition(" ± ")
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
        return _page(f'<div style="{_DIM}">No problems.</div>')
    return _page(
        "".join(
            f'<div style="margin-bottom:3px"><span style="{_DIM}">{time:.1f} s {escape(problem.source)}</span> '
            f"{escape(problem.text)}</div>"
            for time, problem in reversed(newest)
        )
    )


def legend(doubt_scale: float) -> str:
    """What the colours mean, in the scene and in the curves."""
    return _page(
        f'<div style="font-size:12px;margin-top:6px"><b>Scene</b><br>{_dot(TRUTH)} the truth: centre of mass, box of '
        f"equal inertia<br>{_dot(ACCENT)} the chosen robot's estimate; the ellipsoid is 3 std of its centre of mass, "
        f"drawn {doubt_scale:g} × as large<br>{_dot(FORCE)} force, {_dot(TORQUE)} torque of a hand<br>hands: "
        f"{_dot(GOOD)} valid, {_dot(BAD)} stale; links: {_dot(GOOD)} up, {_dot(BAD)} down<br>"
        f"red, green, blue: x, y, z of a grasp frame"
        f'<div style="height:6px"></div><b>Curves</b> of the last 30 s, in the chosen robot\'s grasp frame<br>'
        f"{_dot(ACCENT)} mass, x, xx {_dot(FORCE)} y, yy {_dot(TORQUE)} z, zz<br>"
        f"{_dot(WAITING)} band of ± 3 std, as the robot reports it</div>"
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
    needed = max([digits, *(decimals_for(value, 2) for value in std)])
    decimals = min(needed, _MOST_DECIMALS)
    texts = ["".join(f"{value:.{decimals}f}" for value in values) for values in (truth, estimate)]
    cells = [_right(text or "–") for text in (*texts, "".join(std_text(value, needed) for value in std))]
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
