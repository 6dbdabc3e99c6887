"""Noise of wrenches that is correlated over time: a filter in the sensor, or drives that swing.

It is told from faults by its spectrum, which is smooth and reaches beyond the frequencies of the motion, and by being
the same all the time. Faults leave residuals at the frequencies of the motion, or for a part of the time.
"""

from collections.abc import Sequence

import numpy as np
from scipy.fft import idct
from scipy.optimize import minimize

from coheft.estimation.batch.judge.band import FEW_ABOVE
from coheft.estimation.batch.judge.wrench_misfit import Fit, WrenchMisfit
from coheft.estimation.geometry.spatial import Array

_SURE, _CHANCE = 6.0, 5.0
"""Standard deviations of what is no chance, and of what may be."""
_LARGEST = 20.0
"""Limit of logarithms."""
_LITTLE = 0.1
"""Share of the white noise below which the time of the other's correlation means nothing."""
_PARTS = 10
"""Number of parts of the recording whose residuals are compared."""


def colour_of(misfit: WrenchMisfit, faults: Sequence[tuple[Fit, float]]) -> tuple[Array, float] | None:
    """Power of the noise by frequency, for forces and for moments, in multiples of white noise, shape (K, 2).

    It is measured with the likeliest of some ``faults`` fitted along, which have a cost, or with none. Otherwise the
    residual of a fault would be taken for noise.

    Returns:
        The power, and the time over which the noise is correlated [s]; None if residuals are not such noise.
    """
    if not _reaches_beyond(misfit.plain.residual, misfit):
        return None
    candidates = list[tuple[float, Array, Array, float]]()
    for fit, cost in [(misfit.plain, 0.0), *faults]:
        power = np.mean(fit.residual**2, axis=-1)
        smooth = [_smooth(misfit.band.frequency, own) for own in power.T]
        spectrum = np.stack([own for own, _ in smooth], axis=-1)
        found = 3.0 * float(np.sum(np.log(spectrum) + power / spectrum)) + cost
        candidates.append((found, fit.residual, spectrum, max(span for _, span in smooth)))
    _, residual, colour, time = min(candidates, key=lambda each: each[0])
    if not _reaches_beyond(residual, misfit):
        return None
    relative = np.mean(residual**2, axis=-1) / colour
    for rows in np.array_split(np.arange(len(relative)), misfit.band.intervals):
        if np.any(np.abs(np.log(relative[rows].mean(axis=0))) > _CHANCE * np.sqrt(2.0 / (3.0 * len(rows)))):
            return None
    over_time = idct(residual / np.sqrt(colour)[..., None], axis=0, norm="ortho") ** 2
    for part in np.array_split(over_time, _PARTS):
        if part.mean() > 1.0 + _CHANCE * np.sqrt(2.0 / part.size):
            return None
    return colour, time


def _reaches_beyond(residual: Array, misfit: WrenchMisfit) -> bool:
    """Whether a residual is larger than white noise also above the band of the motion."""
    above = misfit.band.above(residual)
    return above.size > FEW_ABOVE and float(np.mean(above**2)) > 1.0 + _SURE * np.sqrt(2.0 / above.size)


def _smooth(frequency: Array, power: Array) -> tuple[Array, float]:
    """The likeliest sum of white noise and of noise correlated over a time [s], and that time, 0 if all is white."""

    def parts(logs: Array) -> tuple[Array, Array]:
        """The spectrum, and its derivatives by the logarithms, shape (3, K)."""
        white, more, corner = np.exp(logs)
        square = (frequency / corner) ** 2
        coloured = more / (1.0 + square)
        return white + coloured, np.stack(
            [np.full_like(frequency, white), coloured, 2.0 * coloured * square / (1.0 + square)]
        )

    def misfit(logs: Array) -> tuple[float, Array]:
        expected, derivatives = parts(logs)
        ratio = power / expected
        return float(np.sum(np.log(expected) + ratio)), derivatives @ ((1.0 - ratio) / expected)

    level, slow = np.maximum([np.median(power), power[: len(power) // 4].mean()], np.exp(-_LARGEST))
    starts = [np.log([level, slow, corner]) for corner in (0.02, 0.1, 0.5, 2.0)]
    bounds = [(-_LARGEST, _LARGEST)] * 3
    fits = [minimize(misfit, start, jac=True, method="L-BFGS-B", bounds=bounds) for start in starts]
    best = min(fits, key=lambda fit: float(fit.fun)).x
    white, more, corner = np.exp(best)
    return parts(best)[0], float(1.0 / (2.0 * np.pi * corner)) if more > _LITTLE * white else 0.0
