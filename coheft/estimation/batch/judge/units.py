"""Other units of forces and moments, and which factors are no unit."""

from coheft.estimation.batch.judge.verdict import Cause

KGF, LBF, _FOOT, _INCH = 9.80665, 4.4482216, 0.3048, 0.0254
"""In units of N and m."""
_UNITS = {
    Cause.SCALE: ((1.0 / KGF, "kgf and kgf·m"),),
    Cause.FORCE_SCALE: ((1.0 / KGF, "kgf"), (1.0 / LBF, "lbf"), (0.001, "kN")),
    Cause.MOMENT_SCALE: (
        *((1000.0, "N·mm"), (100.0, "N·cm"), (1.0 / KGF, "kgf·m"), (100.0 / KGF, "kgf·cm")),
        *((1.0 / (LBF * _FOOT), "lbf·ft"), (1.0 / (LBF * _INCH), "lbf·in")),
    ),
}
"""Names of units, and how many of them are one of the expected unit."""
_ALIKE = 0.03
"""Relative difference of a factor from that of a unit."""
_NEAR = 2.0
"""Factors between one and this, or their inverses, may be a calibration."""


def unit_of(cause: Cause, factor: float) -> str:
    """The unit with this factor; empty if none is known."""
    return next((unit for size, unit in _UNITS.get(cause, ()) if abs(factor / size - 1.0) < _ALIKE), "")


def is_likely(cause: Cause, factor: float) -> bool:
    """Whether a factor is that of a sign, of a calibration, or of a unit."""
    size = abs(factor)
    if 1.0 / _NEAR < size < _NEAR or unit_of(cause, factor):
        return True
    # That of all moments may be one of all forces.
    return cause is Cause.MOMENT_SCALE and size > 0.0 and bool(unit_of(Cause.FORCE_SCALE, 1.0 / factor))
