"""Results of all tests beside the paper's claims, as a table."""

from collections.abc import Iterable, Sequence

import msgspec

from coheft.app.cart.judge import CartReport
from coheft.app.cart.table_one import QUIET_TESTS, TESTS

HEADER = (
    "test",
    "mass off after 10 s, kg",
    "centre of mass off after 30 s, mm",
    "cart off its path after 5 s, cm",
    "the same without learning, cm",
)
CLAIMS = (
    "paper says",
    "converged",
    "smaller than at first",
    "below 3",
    "above 20",
)
"""Claims of Aguilera et al. about their simulations; they give no numbers per test."""
_SIDES = {"d_x": "along", "d_y": "across"}
"""Directions, by the names of the coordinates of the centre of mass."""

MASS_LIMIT, NOISY_MASS_LIMIT, COM_LIMIT = 0.1, 0.3, 10.0
TRACKING_LIMIT, WITHOUT_LIMIT = 0.03, 0.20
_WITHOUT_TESTS = (1, 4)
_RECOVERY_LIMIT = 1.0


class CartStudy(msgspec.Struct, frozen=True):
    """Results of the command ``coheft cart``."""

    reports: list[CartReport]
    missed: list[str]


def missed(reports: Iterable[CartReport]) -> list[str]:
    """Results that are worse than expected; only tests of Table I have expectations."""
    found = []
    for report in reports:
        if report.test not in TESTS:
            continue
        name = f"test {report.test}, seed {report.seed}"
        if not report.learns:
            if report.test in _WITHOUT_TESTS and report.largest_tracking_error_m < WITHOUT_LIMIT:
                found.append(f"{name}, without the estimator: {100 * report.largest_tracking_error_m:.1f} cm only")
            continue
        limit = MASS_LIMIT if report.test in QUIET_TESTS else NOISY_MASS_LIMIT
        if report.diverged:
            found.append(f"{name}: diverged")
        if abs(report.mass_error_kg) > limit:
            found.append(f"{name}: mass off by {report.mass_error_kg:.2f} kg at 10 s")
        if report.com_known and report.com_error_mm > COM_LIMIT:
            found.append(f"{name}: centre of mass off by {report.com_error_mm:.1f} mm, but said to be known")
        if report.test in QUIET_TESTS and report.largest_tracking_error_m > TRACKING_LIMIT:
            found.append(f"{name}: {100 * report.largest_tracking_error_m:.1f} cm off the path")
        for load in report.loads:
            if load.recovered_after_s is None or load.recovered_after_s > _RECOVERY_LIMIT:
                found.append(f"{name}: not over the load change at {load.at_s:g} s after {_RECOVERY_LIMIT:g} s")
    return found


def rows(reports: Sequence[CartReport]) -> list[tuple[str, ...]]:
    """One row per test: the worst of its runs."""
    result: list[tuple[str, ...]] = []
    for test in sorted({report.test for report in reports}):
        learned = [report for report in reports if report.test == test and report.learns]
        without = [report for report in reports if report.test == test and not report.learns]
        known = [report.com_error_mm for report in learned if report.com_known]
        unknown = [report for report in learned if not report.com_known]
        com = f"{max(known):.1f}" if known else ""
        if unknown:
            sides = [side for name, side in _SIDES.items() if any(name in report.not_known for report in unknown)]
            com += f"{' ' if com else ''}not known {' and '.join(sides)} the cart"
        result.append(
            (
                str(test),
                f"{max(abs(report.mass_error_kg) for report in learned):.3f}" if learned else "",
                com,
                f"{100 * max(report.largest_tracking_error_m for report in learned):.1f}" if learned else "",
                f"{100 * max(report.largest_tracking_error_m for report in without):.0f}" if without else "",
            )
        )
    return result


def sentences(reports: Sequence[CartReport]) -> list[str]:
    """Results beside the table, as sentences."""
    learned = [report for report in reports if report.learns]
    found = []
    loads = [load for report in learned for load in report.loads]
    if loads:
        slowest = [load.recovered_after_s for load in loads]
        late = slowest.count(None)
        times = [time for time in slowest if time is not None]
        found.append(
            f"{len(loads)} load changes: mass within 0.5 kg again after at most {max(times, default=0.0):.1f} s"
            + (f"; never in {late}" if late else "")
            + "."
        )
    if any(not report.com_known for report in learned):
        found.append(
            "Where the centre of mass is along the cart only curves show; across it, speeding up or slowing down."
        )
    for doubt in sorted({doubt for report in learned for doubt in report.doubts}):
        found.append(f"The pushers report: {doubt}.")
    diverged = sum(report.diverged for report in learned)
    found.append(f"{diverged} of {len(learned)} runs diverged.")
    return found
