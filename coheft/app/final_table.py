"""The table and the sentences at the end of a run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from coheft.app.carry_table import print_carry
from coheft.app.judge import RobotReport, why_stale
from coheft.app.report import LoadChangeReport, Report

HEADINGS = ("robot", "quantity", "truth", "estimate", "error", "own std")
LEGEND = (
    "Centre of mass: x y z in the robot's grasp frame. Inertia: principal moments.",
    "Own std: how far off the robot itself expects to be (standard deviation).",
)
RECOVERED = "Recovered: mass within 3 %, centre of mass within 20 mm at every robot."


def print_report(console: Console, report: Report, folder: Path) -> None:
    """The final table, and in sentences what else is worth knowing."""
    console.print()
    console.print(_final_table(report))
    for line in (*LEGEND, *([RECOVERED] if report.load_changes else [])):
        console.print(line, style="dim", highlight=False)
    if report.carry is not None:
        print_carry(console, report.carry)
    console.print()
    for sentence in sentences(report):
        console.print(sentence, markup=False, highlight=False)
    console.print(f"Logs of all processes: {folder}", markup=False, highlight=False, soft_wrap=True)


def _final_table(report: Report) -> Table:
    table = Table(
        title=f"What each robot found out about the payload ({report.duration_s:.1f} s)",
        title_justify="left",
        box=None,
        padding=(0, 1, 0, 0),
        header_style="bold",
        title_style="bold",
    )
    for heading in HEADINGS[:2]:
        table.add_column(heading)
    for heading in HEADINGS[2:]:
        table.add_column(heading, justify="right", no_wrap=True)
    for name, robot in report.robots.items():
        for row in robot_rows(robot):
            table.add_row(name, *row)
            name = ""
    return table


def robot_rows(robot: RobotReport) -> list[tuple[str, str, str, str, str]]:
    """What a robot found out: quantity, truth, estimate, error, own standard deviation, for each quantity."""
    return [_mass_row(robot), _com_row(robot), _inertia_row(robot)]


def _mass_row(robot: RobotReport) -> tuple[str, str, str, str, str]:
    mass = robot.mass
    if mass.estimate is None or mass.std is None:
        return "mass, kg", f"{mass.truth:.3f}", "not observable", "", ""
    return "mass, kg", f"{mass.truth:.3f}", f"{mass.estimate:.3f}", f"{mass.error_pct:.2f} %", f"{mass.std:.3f}"


def _com_row(robot: RobotReport) -> tuple[str, str, str, str, str]:
    com = robot.com
    truth = " ".join(f"{1e3 * x:.0f}" for x in com.truth)
    if com.estimate is None or com.std is None:
        return "centre of mass, mm", truth, "not observable", "", ""
    estimate = " ".join(f"{1e3 * x:.0f}" for x in com.estimate)
    return "centre of mass, mm", truth, estimate, f"{com.error_mm:.1f} mm", f"{1e3 * np.linalg.norm(com.std):.1f}"


def _inertia_row(robot: RobotReport) -> tuple[str, str, str, str, str]:
    inertia = robot.inertia
    truth = _principal(inertia.truth)
    if inertia.estimate is None or inertia.std is None:
        return "inertia, kg·m²", truth, "not observable", "", ""
    std = float(np.linalg.norm(inertia.std))
    return "inertia, kg·m²", truth, _principal(inertia.estimate), f"{inertia.error_pct:.1f} %", f"{std:.3f}"


def _principal(tensor: list[list[float]]) -> str:
    return " ".join(f"{moment:.2f}" for moment in np.linalg.eigvalsh(np.array(tensor)))


def sentences(report: Report) -> list[str]:
    """What else is worth knowing."""
    return [
        *_most([_load_change_sentence(change) for change in report.load_changes]),
        *_pose_sentence(report),
        *_not_observable_sentences(report),
        *_most([f"Stale at {', '.join(names)}: {reason}." for reason, names in why_stale(report.robots).items()]),
        _convergence_sentence(report),
        f"{report.duration_s:g} s simulated at {report.real_time_factor:.1f} times real time; "
        f"{report.processes} processes, {report.messages_per_s:,.0f} messages a second.",
        *([f"{report.late_blocks} times a robot answered too late."] if report.late_blocks else []),
    ]


def _load_change_sentence(change: LoadChangeReport) -> str:
    def after(moment: float | None) -> str:
        return "not by every robot" if moment is None else f"{moment - change.at_s:.1f} s after"

    before = next((robot.mass.truth for robot in change.before_change.values()), None)
    start = f"from {before:.2f} kg " if before is not None else ""
    leak = f", leaking {change.leak_kg_s:g} kg/s" if change.leak_kg_s > 0.0 else ""
    return (
        f"At {change.at_s:g} s the payload changed {start}to {change.truth.mass:.2f} kg{leak}. "
        f"Noticed: {after(change.detected_at_s)}. Recovered: {after(change.recovered_at_s)}."
    )


def _pose_sentence(report: Report) -> list[str]:
    poses = [pose for robot in report.robots.values() for pose in robot.poses.values()]
    if not poses:
        return []
    rotation = max(pose.rotation_error_deg for pose in poses)
    translation = max(pose.translation_error_mm for pose in poses)
    return [f"Where the neighbours hold it: off by at most {rotation:.2f}° and {translation:.1f} mm."]


def _not_observable_sentences(report: Report) -> list[str]:
    """One example of each kind: what is to be done about it, after the last colon, is the same for all of the kind."""
    kinds: dict[str, list[str]] = {}
    for name, robot in report.robots.items():
        for text in robot.not_observable:
            kinds.setdefault(text.rpartition(": ")[2], []).append(f"Not observable for {name}: {text}.")
    return [sentence for kind in kinds.values() for sentence in _most(kind, show=1)]


def _most(found: list[str], show: int = 3) -> list[str]:
    """The first ones, and how many more there are."""
    more = len(found) - show
    if more <= 0:
        return found
    return [*found[:show], f"And {more} more of the kind; the report (--json FILE) has them all."]


def _convergence_sentence(report: Report) -> str:
    missing = [name for name, robot in report.robots.items() if not robot.is_converged]
    if missing:
        return f"Not converged: {', '.join(missing)}."
    first = max(robot.converged_at_s or 0.0 for robot in report.robots.values())
    return f"All robots converged, for the first time at {first:.1f} s."
