"""The report on a recording as tables in the terminal."""

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from coheft.app.identify.report import IdentifyReport
from coheft.app.terminal.digits import decimals_for
from coheft.app.terminal.wide_table import bare_table, print_table

_MOST_DECIMALS = 6
_TEXTS = ("robot", "what", "quantity", "observable")
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
            f"Found pair by pair, before the common fit, poses disagree by up to {worst.rotation_deg:.3f}° and "
            f"{worst.position_mm:.2f} mm around a loop of robots."
        )
    simulated = (
        ""
        if report.errors is None
        else " Errors: differences from the truth, which the simulation recorded; its sensors are exact only with "
        "sensors.tolerance = {}."
    )
    console.print(f"Inertia: principal moments at the centre of mass.{simulated}")
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
    headings = ["robot", "rotation, °", "std, °", "position, mm", "std, mm"]
    errors = report.errors
    table = _table("Grasps", *headings, *([] if errors is None else ["error, °", "error, mm"]))
    for name, pose in report.poses.items():
        if pose is None:
            table.add_row(escape(name), _UNOBSERVABLE)
            continue
        row = [
            escape(name),
            _numbers(pose.rotation_vector_deg, 2),
            f"{pose.rotation_std_deg:.3f}",
            _numbers([1e3 * x for x in pose.position_m], 1),
            f"{pose.position_std_mm:.2f}",
        ]
        if errors is not None:
            pair = f"{report.robots[0]}-{name}"
            row += [f"{errors.rotation_deg[pair]:.3f}", f"{errors.position_mm[pair]:.2f}"]
        table.add_row(*row)
    return table


def _payload(report: IdentifyReport) -> Table:
    payload, errors = report.payload, report.errors
    table = _table("Load", "quantity", "estimate", "std", *([] if errors is None else ["error"]))

    def add(label: str, values: list[float] | None, stds: list[float] | None, error: str) -> None:
        if values is None or stds is None:
            table.add_row(label, _UNOBSERVABLE)
        else:
            decimals = min(_MOST_DECIMALS, decimals_for(max(stds), 2))
            table.add_row(label, _numbers(values, decimals), _numbers(stds, decimals), *([error] if errors else []))

    mass_error, com_error, moments = (
        (None, None, None) if errors is None else (errors.mass_kg, errors.com_mm, errors.principal_pct)
    )
    add("mass, kg", _each(payload.mass_kg), _each(payload.mass_std_kg), _error(_each(mass_error), 4, "kg"))
    add("centre of mass, mm", _mm(payload.com_m), _mm(payload.com_std_m), _error(_each(com_error), 2, "mm"))
    add("inertia, kg·m²", payload.principal, payload.principal_std, _error(moments, 1, "%"))
    table.add_row("principal axes, °", _UNOBSERVABLE if payload.axes_deg is None else _numbers(payload.axes_deg, 2))
    return table


def _table(title: str, *headings: str) -> Table:
    table = bare_table(title, gap=1)
    for heading in headings:
        table.add_column(heading, justify="left" if heading in _TEXTS else "right")
    return table


def _each(value: float | None) -> list[float] | None:
    return None if value is None else [value]


def _mm(metres: list[float] | None) -> list[float] | None:
    return None if metres is None else [1e3 * x for x in metres]


def _error(values: list[float] | None, decimals: int, unit: str) -> str:
    return "" if values is None else f"{_numbers(values, decimals)} {unit}"


def _numbers(values: list[float], decimals: int) -> str:
    return " ".join(f"{value:z.{decimals}f}" for value in values)


def _calibration(report: IdentifyReport) -> Table:
    table = _table("Calibration", "robot", "what", "found", "std", "std before", "observable")
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
