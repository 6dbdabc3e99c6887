"""The report on a recording as tables in the terminal."""

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from coheft.app.identify.report import IdentifyReport
from coheft.app.terminal.wide_table import print_table

_UNOBSERVABLE = "not observable"


def print_identification(console: Console, report: IdentifyReport) -> None:
    """Print tables of the estimates and their standard deviations, and all remarks."""
    first = report.robots[0]
    when = "held still" if report.method == "static" else f"{report.from_s:.1f} s to {report.to_s:.1f} s"
    console.print(
        f"{report.recording}: {len(report.robots)} robots, {when}, method {report.method}. All in the "
        f"grasp frame of {first}.",
        markup=False,
    )
    print_table(console, _poses(report))
    print_table(console, _payload(report))
    if report.loops:
        worst = max(report.loops, key=lambda loop: loop.position_mm)
        console.print(
            f"Before pairs were fitted together, their loops failed to close by up to {worst.rotation_deg:.3f}° and "
            f"{worst.position_mm:.2f} mm."
        )
    if report.errors is not None:
        console.print("Errors are against the truth, which this recording names: it was simulated.")
    if report.holds_s:
        console.print(f"Held still {len(report.holds_s)} times, in {report.hold_orientations} orientations.")
    if report.calibration:
        print_table(console, _calibration(report))
    if not report.payload.was_possible and report.payload.inertia is not None and not report.doubts:
        console.print(
            f"The best fit is physically impossible; this is the most likely possible body, "
            f"{report.payload.deviations_off:.1f} standard deviations away."
        )
    unobservable = (f"Not observable: {what}" for what in report.not_observable)
    unjudged = (
        [] if report.not_judged is None else [f"Not judged, so that nothing has checked it: {report.not_judged}."]
    )
    doubts = (f"Do not trust these numbers: {what}" for what in report.doubts)
    for text in (*unobservable, *report.remarks, *unjudged, *doubts):
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
        if pose is None:
            table.add_row(escape(name), _UNOBSERVABLE)
            continue
        row = [
            escape(name),
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
    if errors is not None:
        table.add_column("error")
    mass_error, com_error, moments = (
        (None, None, None) if errors is None else (errors.mass_kg, errors.com_mm, errors.principal_pct)
    )

    def add(label: str, value: str, std: str = "", error: str = "") -> None:
        table.add_row(label, *((value, std, error) if value else (_UNOBSERVABLE,))[: len(table.columns) - 1])

    add("mass, kg", _numbers(payload.mass_kg), _numbers(payload.mass_std_kg), _numbers(mass_error, 4, " kg"))
    add("centre of mass, m", _numbers(payload.com_m), _numbers(payload.com_std_m), _numbers(com_error, 2, " mm"))
    for k in range(3):
        value, std, error = (
            None if numbers is None else numbers[k] for numbers in (payload.principal, payload.principal_std, moments)
        )
        add(f"principal inertia {k + 1}, kg·m²", _numbers(value), _numbers(std), _numbers(error, 2, " %"))
    add("principal axes, deg", _numbers(payload.axes_deg, 2))
    return table


def _numbers(values: float | list[float] | None, digits: int = 4, unit: str = "") -> str:
    """Text of a cell with numbers; empty for None."""
    if values is None:
        return ""
    return " ".join(f"{value:.{digits}f}" for value in (values if isinstance(values, list) else [values])) + unit


def _calibration(report: IdentifyReport) -> Table:
    table = Table(
        "robot", "what", "found", "std", "std before", "observable", title="Calibration", title_justify="left"
    )
    for row in report.calibration:
        table.add_row(
            escape(row.robot),
            row.what,
            f"{row.value:.3f} {row.unit}",
            f"{row.std:.3f}",
            f"{row.std_before:.3f}",
            "yes" if row.seen else "no",
        )
    return table
