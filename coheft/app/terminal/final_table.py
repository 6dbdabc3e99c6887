"""The table and the sentences printed at the end of a run."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from coheft.app.names import few
from coheft.app.results.errors import MOST_STDS
from coheft.app.results.judge import RobotReport, Verdict, why_stale
from coheft.app.results.report import Report
from coheft.app.results.slips import SlipReport
from coheft.app.results.states import LACKS, State
from coheft.app.terminal.carry_table import print_carry
from coheft.app.terminal.digits import decimals_for, error_and_std, significant
from coheft.app.terminal.load_sentences import load_change_sentences
from coheft.app.terminal.sensor_sentences import sensor_sentences
from coheft.app.terminal.wide_table import bare_table, full_width, needed_width, print_table
from coheft.estimation.geometry.spatial import Array

_HEADINGS = ("robot", "quantity", "truth", "estimate", "error", "own std")
_STACKED_HEADINGS = ("robot", "quantity", "truth / estimate", "error", "own std")
LEGEND = (
    "Centre of mass: x y z in the robot's grasp frame. Inertia: principal moments.",
    "Own std: the standard deviation that the robot itself reports, in the unit of "
    "the error. Percentages are of the truth. An error that is too large for its own "
    "std is followed by their ratio.",
)
BOUND = (
    "Bound: the smallest root mean square error of any unbiased estimator that has all "
    "samples of all robots' sensors up to then (Cramér and Rao).",
)
TEXT_HEADINGS = ("robot", "quantity", "estimator")
_SHOWN = 3
"""Largest number of sentences of a kind, and of robots named in a sentence."""
RECOVERED = "Recovered: mass within 3 %, centre of mass within 20 mm at every robot."


def print_report(console: Console, report: Report, folder: Path) -> None:
    """Print the final table and the sentences that complete it."""
    console.print()
    print_table(console, _final_table(console, report))
    for line in legend(report):
        console.print(line, style="dim", highlight=False)
    if report.carry is not None:
        print_carry(console, report.carry)
    console.print()
    for sentence in sentences(report):
        console.print(sentence, markup=False, highlight=False)
    console.print(f"Logs of all processes: {folder}", markup=False, highlight=False, soft_wrap=True)


def _final_table(console: Console, report: Report) -> Table:
    """Return the table; that of several estimators is stacked if it would not fit into the window otherwise."""
    time = f"{report.duration_s:.1f} s"
    table = _table(f"{time}, {', '.join(report.by_estimator)}", headings(report), table_rows(report))
    if not report.beside or full_width(console, table) <= console.width:
        return table
    rows = {name: list(_stacked(rows, has_bound=report.bound is not None)) for name, rows in table_rows(report).items()}
    stacked = _table(time, (*_STACKED_HEADINGS, *(("bound",) if report.bound else ())), rows)
    return stacked if needed_width(console, stacked) <= console.width else table


def _table(run: str, columns: Iterable[str], rows_of: Mapping[str, list[tuple[str, ...]]]) -> Table:
    table = bare_table(f"What each robot found out about the payload ({run})", gap=1)
    for heading in columns:
        is_text = heading in TEXT_HEADINGS
        table.add_column(heading, justify="left" if is_text else "right", no_wrap=not is_text)
    for name, rows in rows_of.items():
        for row in rows:
            table.add_row(name, *row)
            name = ""
    return table


def _stacked(rows: Iterable[tuple[str, ...]], *, has_bound: bool) -> Iterator[tuple[str, ...]]:
    """Yield the rows of several estimators with fewer columns: for each quantity one with its truth and bound, then one
    for each estimator.
    """
    for quantity, truth, estimator, estimate, error, std, *bound in rows:
        if quantity:
            yield quantity, truth, "", "", *bound
        yield f"  {estimator}", estimate, error, std, *([""] if has_bound else [])


def headings(report: Report) -> tuple[str, ...]:
    """Return the headings of the table, the robot's first."""
    if not report.beside:
        return _HEADINGS
    return (*_HEADINGS[:3], "estimator", *_HEADINGS[3:], *(("bound",) if report.bound else ()))


def table_rows(report: Report) -> dict[str, list[tuple[str, ...]]]:
    """Return each robot's rows: one for each quantity, and if several estimators ran, for each of these below it."""
    if not report.beside:
        return {name: list(robot_rows(robot)) for name, robot in report.robots.items()}
    return {name: list(_rows_side_by_side(report, name)) for name in report.robots}


def _rows_side_by_side(report: Report, name: str) -> Iterator[tuple[str, ...]]:
    """Yield a robot's rows; quantity, truth and bound stand in the first of the estimators' rows only."""
    bounds: list[tuple[str, ...]] = [(), (), ()]
    if report.bound is not None:
        bound = report.bound[name]
        parts = (bound.mass_pct, "%"), (bound.com_mm, "mm"), (bound.inertia_pct, "%")
        bounds = [(error_and_std(size, size, unit)[1],) for size, unit in parts]
    robots = {estimator: robot_rows(other.robots[name]) for estimator, other in report.by_estimator.items()}
    for k, last in enumerate(bounds):
        for estimator, rows in robots.items():
            quantity, truth, *found = rows[k]
            if estimator == report.estimator:
                yield quantity, truth, estimator, *found, *last
            else:
                yield "", "", estimator, *found


def legend(report: Report) -> list[str]:
    """Return the lines that explain the table."""
    return [*LEGEND, *(BOUND if report.bound else ()), *([RECOVERED] if report.load_changes else ())]


def robot_rows(robot: RobotReport) -> list[tuple[str, str, str, str, str]]:
    """Return the rows of a robot: quantity, truth, estimate, error and own standard deviation, for each quantity."""
    rows = {"mass": _mass_row(robot), "centre of mass": _com_row(robot), "inertia": _inertia_row(robot)}
    too_far = {each.quantity: each.stds for each in robot.contradictions}
    return [
        (*row[:4], f"{row[4]} ({significant(too_far[quantity], 3)}×)") if quantity in too_far else row
        for quantity, row in rows.items()
    ]


def _mass_row(robot: RobotReport) -> tuple[str, str, str, str, str]:
    mass = robot.mass
    decimals = decimals_for(mass.truth, 4, at_least=3)
    truth = f"{mass.truth:.{decimals}f}"
    if mass.estimate is None or mass.std is None or mass.error_pct is None:
        return "mass, kg", truth, _missing(robot), "", ""
    compared = error_and_std(mass.error_pct, 100.0 * mass.std / mass.truth, "%")
    return "mass, kg", truth, f"{mass.estimate:.{decimals}f}", *compared


def _com_row(robot: RobotReport) -> tuple[str, str, str, str, str]:
    com = robot.com
    truth = _numbers(1e3 * np.array(com.truth))
    if com.estimate is None or com.std is None or com.error_mm is None:
        return "centre of mass, mm", truth, _missing(robot), "", ""
    compared = error_and_std(com.error_mm, 1e3 * float(np.linalg.norm(com.std)), "mm")
    return "centre of mass, mm", truth, _numbers(1e3 * np.array(com.estimate)), *compared


def _inertia_row(robot: RobotReport) -> tuple[str, str, str, str, str]:
    inertia = robot.inertia
    moments = np.linalg.eigvalsh(np.array(inertia.truth))
    decimals = decimals_for(moments.max(), 2, at_least=2)
    truth = _numbers(moments, decimals)
    if inertia.estimate is None or inertia.std is None or inertia.error_pct is None:
        return "inertia, kg·m²", truth, _missing(robot), "", ""
    std_pct = 100.0 * float(np.linalg.norm(inertia.std) / np.linalg.norm(inertia.truth))
    estimate = _numbers(np.linalg.eigvalsh(np.array(inertia.estimate)), decimals)
    return "inertia, kg·m²", truth, estimate, *error_and_std(inertia.error_pct, std_pct, "%")


def _missing(robot: RobotReport) -> str:
    return "not observable" if robot.not_observable else "not known"


def _numbers(values: Array, decimals: int = 0) -> str:
    return " ".join(f"{value:z.{decimals}f}" for value in values)  # z: no minus sign for zero


def sentences(report: Report) -> Iterator[str]:
    """Yield the sentences that complete the table."""
    yield from _most(load_change_sentences(report.load_changes))
    yield from _most([_slip_sentence(slip) for slip in report.slips])
    restarts = [(change.since_s, change.estimator) for change in report.estimator_changes]
    yield from _most([f"At {at:g} s all robots restarted with the estimator {name}." for at, name in restarts])
    if poses := [pose for robot in report.robots.values() for pose in robot.poses.values()]:
        rotation = max(pose.rotation_error_deg for pose in poses)
        translation = max(pose.translation_error_mm for pose in poses)
        yield f"Poses of the neighbours: off by at most {rotation:.2f}° and {translation:.1f} mm."
    yield from _not_observable_sentences(report)
    yield from _most([f"Stale at {', '.join(names)}: {reason}." for reason, names in why_stale(report.robots).items()])
    yield from _most(sensor_sentences(report.robots))
    yield from _convergence_sentences(report)
    for name, other in report.beside.items():
        yield from (f"{name}: {text}" for text in _convergence_sentences(other))
    if report.real_time_factor:  # which is unknown if the report was made from a recording
        yield (
            f"{report.duration_s:g} s simulated at {report.real_time_factor:.1f} times real time; "
            f"{report.processes} processes, {report.messages_per_s:,.0f} messages a second."
        )
    if late := report.late_blocks:
        yield (
            f"{'Once' if late == 1 else f'{late:,} times'} a robot answered too late: this machine was too slow for "
            f"real time. Leave out --realtime, or raise 'lookahead' or 'sensors.block' in the scenario."
        )


def _slip_sentence(slip: SlipReport) -> str:
    named = "Not all robots found that"
    if slip.named_at_s is not None:
        named = f"All robots had found that after {slip.named_at_s - slip.at_s:.1f} s"
    return (
        f"At {slip.at_s:g} s the grasp of {slip.robot} slipped by {slip.translation_mm:.1f} mm and "
        f"{slip.rotation_deg:.1f}°. {named}."
    )


def _not_observable_sentences(report: Report) -> Iterator[str]:
    """Yield one example of each kind; the advice after the last colon is the same for all of a kind."""
    kinds: dict[str, list[str]] = {}
    for name, robot in report.robots.items():
        for text in robot.not_observable:
            kinds.setdefault(text.rpartition(": ")[2], []).append(f"Not observable for {name}: {text}.")
    for kind in kinds.values():
        yield from _most(kind, show=1)


def _most(found: list[str], show: int = _SHOWN) -> list[str]:
    """Return the first sentences, and how many more there are."""
    more = len(found) - show
    if more <= 0:
        return found
    return [*found[:show], f"And {more} more; the report (--json FILE) lists them all."]


def _convergence_sentences(report: Report) -> Iterator[str]:
    """Describe the convergence: of all robots together if all have converged, otherwise of groups of robots."""
    if report.converged:
        first = max(robot.converged_at_s or 0.0 for robot in report.robots.values())
        yield f"All robots converged, for the first time at {first:.1f} s."
        return
    yield from _contradictions(report.robots)
    if missing := {name: robot for name, robot in report.robots.items() if robot.verdict is Verdict.NOT_CONVERGED}:
        yield _not_converged(missing)


def _contradictions(robots: Mapping[str, RobotReport]) -> Iterator[str]:
    """Describe robots whose errors contradict their own std, with the worst quantity of each."""
    found = []
    for name, robot in robots.items():
        if robot.contradictions:
            worst = max(robot.contradictions, key=lambda each: each.stds)
            found.append((worst.stds, f"{name} ({worst.quantity}, by {significant(worst.stds, 3)} own std)"))
    if found:
        texts = [text for _, text in sorted(found, reverse=True)]
        yield (
            f"Further off than they claim: {few(texts, most=_SHOWN + 1)}; up to {MOST_STDS:g} is normal. "
            f"Do not rely on their std: the sensors or the load are not as the robots assume."
        )


def _lack(robot: RobotReport) -> str:
    """Describe what a robot lacks; a pose that it has not found yet may still become observable."""
    if robot.not_observable and robot.state not in (State.STALE, State.FINDING_NEIGHBOURS):
        return "not everything is observable"
    return LACKS.get(robot.state, robot.state)


def _not_converged(missing: Mapping[str, RobotReport]) -> str:
    """Describe which robots have not converged and what they lack; other sentences explain stale ones and motions."""
    names: dict[str, list[str]] = {}
    for name, robot in missing.items():
        names.setdefault(_lack(robot), []).append(name)
    each = [f"{', '.join(group)} ({lack})" for lack, group in names.items()]
    is_time = any(robot.state in LACKS and not robot.not_observable for robot in missing.values())
    return f"Not converged: {'; '.join(each)}.{' --duration gives more time.' if is_time else ''}"
