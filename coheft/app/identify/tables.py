"""The report on a recording for people."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from coheft.app.identify.report import IdentifyReport


def print_identification(console: Console, report: IdentifyReport) -> None:
    """Print tables of what was found, how sure it is, and what is not known."""
    first = report.robots[0]
    console.print(
        f"{report.recording}: {len(report.robots)} robots, {report.from_s:.1f} s to {report.to_s:.1f} s, "
        f"method {report.method}. All in the grasp frame of {first}."
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
        console.print(text)


def _poses(report: IdentifyReport) -> Table:
    table = Table(
        "robot", "rotation vector, deg", "std", "position, m", "std, mm", title="Grasps", title_justify="left"
    )
    errors = report.errors
    if errors is not None:
        table.add_column("error, deg")
        table.add_column("error, mm")
    for name, pose in report.poses.items():
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
    mass, com, principal = ["", "", ""] if errors is None else [_mass(errors.mass_kg), _mm(errors.com_mm), ""]
    moments = (
        [""] * 3 if errors is None or errors.principal_pct is None else [f"{e:.2f} %" for e in errors.principal_pct]
    )
    if errors is not None:
        table.add_column("error")
    rows = [
        ["mass, kg", f"{payload.mass_kg:.4f}", f"{payload.mass_std_kg:.4f}", mass],
        [
            "centre of mass, m",
            " ".join(f"{x:.4f}" for x in payload.com_m),
            " ".join(f"{x:.4f}" for x in payload.com_std_m),
            com,
        ],
        *(
            [f"principal inertia {k + 1}, kg·m²", f"{value:.4f}", f"{std:.4f}", error]
            for k, (value, std, error) in enumerate(zip(payload.principal, payload.principal_std, moments, strict=True))
        ),
        ["principal axes, deg", " ".join(f"{x:.2f}" for x in payload.axes_deg), "", principal],
    ]
    for row in rows:
        table.add_row(*(row if errors is not None else row[:3]))
    return table


def _mass(error: float | None) -> str:
    return "" if error is None else f"{error:.4f} kg"


def _mm(error: float | None) -> str:
    return "" if error is None else f"{error:.2f} mm"


def _calibration(report: IdentifyReport) -> Table:
    table = Table("robot", "what", "found", "std", "std before", "", title="Calibration", title_justify="left")
    for row in report.calibration:
        told = "" if row.seen else "not seen"
        table.add_row(
            row.robot, row.what, f"{row.value:.3f} {row.unit}", f"{row.std:.3f}", f"{row.std_before:.3f}", told
        )
    return table
