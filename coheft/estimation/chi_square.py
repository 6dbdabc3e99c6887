"""Quantiles of the chi-square distribution.

They are computed in closed form for integer degrees of freedom, because loading SciPy's special functions would take 22
MB and half of an agent's import time.
"""

import math
from functools import cache

_STEPS = 100
"""Steps of the bisection, enough for all digits."""


def exceedance(value: float, freedom: int) -> float:
    """Return the probability that a chi-square variable is larger than ``value``.

    ``Q(k/2, x/2)`` by ``Q(a + 1, y) = Q(a, y) + y^a e^-y / gamma(a + 1)`` from ``Q(1/2, y) = erfc(sqrt(y))`` or
    ``Q(1, y) = e^-y`` (DLMF 8.8.6, 8.4.6, 8.4.8): all terms are positive, so the smallest probabilities are exact, too.

    Args:
        value: A non-negative value.
        freedom: Degrees of freedom, at least 1.
    """
    half = 0.5 * value
    if half <= 0.0:
        return 1.0
    order, probability = (1.0, math.exp(-half)) if freedom % 2 == 0 else (0.5, math.erfc(math.sqrt(half)))
    while order < 0.5 * freedom:
        probability += math.exp(order * math.log(half) - half - math.lgamma(order + 1.0))
        order += 1.0
    return probability


@cache
def chi_square_threshold(freedom: int, probability: float) -> float:
    """Return the value that a chi-square variable exceeds with a given probability.

    Args:
        freedom: Degrees of freedom.
        probability: The probability, between 0 and 1.

    Raises:
        ValueError: An argument is out of range.
    """
    if freedom < 1 or not 0.0 < probability < 1.0:
        raise ValueError(f"{freedom=} and {probability=} but expected at least 1, and a number between 0 and 1")
    low, high = 0.0, float(freedom)
    while exceedance(high, freedom) > probability:
        low, high = high, 2.0 * high
    for _ in range(_STEPS):
        middle = 0.5 * (low + high)
        if exceedance(middle, freedom) > probability:
            low = middle
        else:
            high = middle
    return high
