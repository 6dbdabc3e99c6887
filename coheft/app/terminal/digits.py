"""Numbers with as many digits as are significant."""

import math

import numpy as np

from coheft.wire.scenario.schema import MAX_DURATION

_MOST_DECIMALS = 6


def decimals_for(value: float, digits: int, at_least: int = 0) -> int:
    """Return the number of decimals with which a value shows a number of significant digits."""
    if not (math.isfinite(value) and value != 0.0):
        return at_least
    return max(at_least, digits - 1 - math.floor(math.log10(abs(value))))


def significant(value: float, digits: int) -> str:
    """Format a number with so many significant digits, without an exponent."""
    return np.format_float_positional(value, digits, unique=False, fractional=False, trim="-")


def seconds_of(time: float, duration: float) -> str:
    """Describe the progress of a run [s]; a run without an end shows the time only."""
    return f"{time:.1f} s" if duration >= MAX_DURATION else f"{time:.1f} of {duration:g} s"


def error_and_std(error: float, std: float, unit: str) -> tuple[str, str]:
    """Format an error and its standard deviation, with the decimals with which the latter shows two digits."""
    decimals = decimals_for(std, 2)
    form = f".{decimals}f" if decimals <= _MOST_DECIMALS else ".1e"
    return f"{error:{form}} {unit}", f"{std:{form}} {unit}"


def value_and_std(value: float, std: float, at_least: int = 3) -> str:
    """Format a value and its standard deviation, with the decimals with which the latter shows two digits."""
    decimals = decimals_for(std, 2, at_least=at_least)
    return f"{value:.{min(decimals, _MOST_DECIMALS)}f} ± {std_text(std, decimals)}"


def std_text(std: float, decimals: int) -> str:
    """Format a standard deviation with a number of decimals; it is never rounded to zero."""
    return f"{std:.{decimals}f}" if decimals <= _MOST_DECIMALS or std == 0.0 else f"{std:.1e}"
