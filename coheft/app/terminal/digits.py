"""Numbers with as many digits as say something."""

from __future__ import annotations

import math

_MOST_DECIMALS = 6


def decimals_for(value: float, digits: int, at_least: int = 0) -> int:
    """Decimals with which a value shows so many significant digits."""
    if not (math.isfinite(value) and value != 0.0):
        return at_least
    return max(at_least, digits - 1 - math.floor(math.log10(abs(value))))


def error_and_std(error: float, std: float, unit: str) -> tuple[str, str]:
    """An error and the standard deviation that it is to be compared with.

    Both have the decimals with which the standard deviation shows two digits.
    """
    decimals = decimals_for(std, 2)
    form = f".{decimals}f" if decimals <= _MOST_DECIMALS else ".1e"
    return f"{error:{form}} {unit}", f"{std:{form}} {unit}"


def value_and_std(value: float, std: float) -> str:
    """A value and its standard deviation, in the same unit and with at least three decimals."""
    decimals = min(decimals_for(std, 2, at_least=3), _MOST_DECIMALS)
    return f"{value:.{decimals}f} ± {std:.{decimals}f}"
