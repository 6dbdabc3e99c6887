"""Terminal output of how well the load was carried."""

from rich.console import Console

from coheft.app.results.report import CarryPhaseReport, CarryReport, LoadDropReport
from coheft.app.terminal.wide_table import bare_table, print_table

_WHAT = {
    "alone": "each for itself",
    "springs": "together, springs",
    "feedforward": "with feed-forward",
}


def print_carry(console: Console, report: CarryReport) -> None:
    """Print a row for each phase and a sentence for each load change."""
    table = bare_table("How the load was carried (root mean squares)", gap=2)
    table.add_column("what", no_wrap=True)
    for heading in ("time, s", "off the path", "against each other"):
        table.add_column(heading, justify="right", no_wrap=True)
    for phase in report.phases:
        table.add_row(*_row(phase))
    table.add_row("sensors' noise", "", "", _pushed(report.noise_force_n, report.noise_torque_nm))
    console.print()
    print_table(console, table)
    is_promised = {"springs", "feedforward"} <= {phase.what for phase in report.phases}
    for drop in report.drops:
        console.print(_sentence(drop, is_promised=is_promised), markup=False, highlight=False)


def _row(phase: CarryPhaseReport) -> tuple[str, str, str, str]:
    off = ""
    if phase.position_rms_mm is not None and phase.rotation_rms_deg is not None:
        off = f"{phase.position_rms_mm:.2f} mm {phase.rotation_rms_deg:.2f}°"
    pushed = _pushed(phase.internal_force_rms_n, phase.internal_torque_rms_nm)
    return _WHAT[phase.what], f"{phase.from_s:.1f} to {phase.to_s:.1f}", off, pushed


def _pushed(force: float, torque: float) -> str:
    return f"{force:.2f} N {torque:.2f} N·m"


def _sentence(drop: LoadDropReport, *, is_promised: bool) -> str:
    """Describe a load change; only with both phases is there a limit for being back on the path."""
    back = "not back on it" if drop.back_after_s is None else f"back on it after {drop.back_after_s:.1f} s"
    end = f", {back}" if is_promised else ""
    return f"At {drop.at_s:g} s the load changed to {drop.mass:.2f} kg: {drop.largest_mm:.1f} mm off the path{end}."
