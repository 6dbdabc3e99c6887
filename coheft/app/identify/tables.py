"""The report on a recording for people."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from coheft.app.identify.report import IdentifyReport

_UNSEEN = "not seen"


def print_identification(console: Console, report: IdentifyReport) -> None:
    """Print tables of what was found, how sure it is, and what is not known."""
    first = report.robots[0]
    console.print(
        f"{report.recording}: {len(report.robots)} robots, {report.from_s:.1f} s to {report.to_s:.1f} s, "
        f"method {report.method}. All in the grasp frame of {first}.",
        markup=False,
    )
    console.print(_poses(report), _payload(report))
    if report.loops:
        worst = max(report.loops, key=lambda loop: loop.position_mm)
        console.print(f"Pairs alone fail to close by up to {worst.rotation_deg:.3f}° and {worst.position_mm:.2f} mm.")
    if report.holds_s:
        console.print(f"Held still {len(report.holds_s)} times, in {report.hold_orientations} orientations.")
    if report.calibration:
        console.print(_calibration(report))
    if not report.payload.was_possible:
        console.print("What was solved for is no body that can exist; this is the most likely one that is.")
    for text in (*(f"Not observable: {what}" for what in report.not_observable), *report.remarks):
        console.print(text, markup=False)


def _poses(report: IdentifyReport) -> Table:
    table = Table(
        "robot", "rotation vector, deg", "std", "position, m", "std, mm", title="Grasps", title_justify="left"
    )
    errors = report.errors
    if errors is not None:
        table.add_column("error, deg")
        table.add_column("error, mm")
    for name, pose in report.poses.items():
        if _is_unseen(report, f"pose of {name}"):
            table.add_row(name, _UNSEEN)
            continue
        row = [
            name,
            " ".join(f"{x:.3f}" for x in pose.rotation_vector_deg),
            f"{pose.rotation_std_deg:.3f}",
            " ".join(f"{x:.4f}" for x in pose.position_m),
            f"{pose.position_std_mm:.2f}",
        ]
        if errors is not None:
            pair = f"{report.robots[0]}-{name}"
            row += [f"{errors.rotation_deg[pair]:.3f}", f"{errors.position_mm[pair]:.2f}"]
        table.add_row(*row)
    return table


def _payload(report: IdentifyReport) -> Table:
    payload, errors = report.payload, report.errors
    table = Table("quantity", "estimate", "std", title="Load", title_justify="left")
    moments = ["", "", ""]
    if errors is not None:
        table.add_column("error")
        moments = [f"{error:.2f} %" for error in errors.principal_pct or []] or moments

    def add(quantity: str, label: str, *cells: str) -> None:
        cells = (_UNSEEN,) if _is_unseen(report, quantity) else cells
        table.add_row(label, *cells[: len(table.columns) - 1])

    mass_error, com_error = (None, None) if errors is None else (errors.mass_kg, errors.com_mm)
    add("mass", "mass, kg", f"{payload.mass_kg:.4f}", f"{payload.mass_std_kg:.4f}", _text(mass_error, "kg", 4))
    com, com_std = (" ".join(f"{x:.4f}" for x in numbers) for numbers in (payload.com_m, payload.com_std_m))
    add("centre of mass", "centre of mass, m", com, com_std, _text(com_error, "mm", 2))
    rows = zip(payload.principal, payload.principal_std, moments, strict=True)
    for k, (value, std, error) in enumerate(rows, 1):
        add("inertia", f"principal inertia {k}, kg·m²", f"{value:.4f}", f"{std:.4f}", error)
    add("inertia", "principal axes, deg", " ".join(f"{x:.2f}" for x in payload.axes_deg), "", "")
    return table


def _is_unseen(report: IdentifyReport, quantity: str) -> bool:
    return any(what.startswith(quantity) for what in report.not_observable)


def _text(error: float | None, unit: str, digits: int) -> str:
    return "" if error is None else f"{error:.{digits}f} {unit}"


def _calibration(report: IdentifyReport) -> Table:
    table = Table("robot", "what", "found", "std", "std before", "", title="Calibration", title_justify="left")
    for row in report.calibration:
        told = "" if row.seen else "not seen"
        table.add_row(
            row.robot, row.what, f"{row.value:.3f} {row.unit}", f"{row.std:.3f}", f"{row.std_before:.3f}", told
        )
    return table
