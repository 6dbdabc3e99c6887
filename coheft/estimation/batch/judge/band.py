"""The frequency band in which a load moves, and the filter that it needs.

Noise is measured just above the band, where there is no motion: still higher, a sensor's own filter may suppress it.

Filters reduce fast parts of a motion, and of the forces that go with it, but not in proportion: forces depend on
products of velocities. So a motion has to be slower than the filter.
"""

import numpy as np
import numpy.typing as npt
from scipy.fft import dct

from coheft.estimation.batch.recording import Recording
from coheft.estimation.batch.signals import CUTOFF, ORDER, Signals, without_jumps
from coheft.estimation.geometry.spatial import Array

_USED = 5.0 / 6.0
"""Share of the filter's band that is used: above, its gain is too small to divide by."""
_NOISE = (4.0 / 3.0, 8.0 / 3.0)
"""Band in which noise is measured, in multiples of the filter's cutoff."""
HIGHEST = 0.16
"""Largest cutoff of the filter, relative to the rate: noise is measured above it."""
_MOTION_POWER = 0.98
_WIDER = 1.3
_FEWEST, _MOST_BANDS, _PER_BAND = 3, 12, 8
FEW_ABOVE = 60
"""Numbers above the band that tell the level of noise there."""
_HIGHEST_CUTOFF = 12.0
"""No robot moves a load so fast that it needs a higher one [Hz]."""
_FAST = 1e-4
"""Share of the power of velocities that a filter may take away."""
_SURE = 6.0
"""Standard deviations by which noise may exceed its mean."""
_CHANCE = 5.0
"""Correlation that may be chance, times the square root of the number of frequencies."""
_LEAST = 0.01
"""Least eigenvalue of correlations, so that noise has an inverse."""


def white_level(samples: Array, rate: float, cutoff: float) -> Array | None:
    """Standard deviation of white noise with the power of samples (n, c) above the band, shape (c,).

    The median of the periodogram is robust against single lines. None if the rate is too low, or samples are too few.
    """
    chosen = _above(len(samples), rate, cutoff)
    if chosen is None:
        return None
    level: Array = np.sqrt(np.median(periodogram(samples)[chosen], axis=0) / np.log(2.0))
    return level


def correlations(samples: Array, rate: float, cutoff: float) -> Array:
    """Correlations (c, c) of the noise above the band between samples (n, c), zero where they may be chance.

    Phases tell, so that single lines have no more weight than other frequencies. They need what ``white_level`` needs.
    """
    chosen = _above(len(samples), rate, cutoff)
    assert chosen is not None  # the level of noise is known
    spectrum = _spectrum(samples)[chosen]
    phases = spectrum / np.maximum(np.abs(spectrum), 1e-300)
    alike = np.real(phases.conj().T @ phases) / len(phases)
    linear = 4.0 / np.pi  # of small correlations of normally distributed noise
    found = alike * (linear - (linear - 1.0) * alike**2)
    found[np.abs(found) < _CHANCE / np.sqrt(len(phases))] = 0.0
    np.fill_diagonal(found, 1.0)
    values, vectors = np.linalg.eigh(found)
    possible = (vectors * np.maximum(values, _LEAST)) @ vectors.T
    sizes = np.sqrt(np.diag(possible))
    result: Array = possible / np.outer(sizes, sizes)
    return result


def _above(count: int, rate: float, cutoff: float) -> npt.NDArray[np.bool_] | None:
    """Which frequencies of so many samples are just above the band; None if there are too few."""
    frequency = np.fft.rfftfreq(count, 1.0 / rate)
    chosen = (frequency >= _NOISE[0] * cutoff) & (frequency <= _NOISE[1] * cutoff)
    if _NOISE[1] * cutoff > 0.45 * rate or np.count_nonzero(chosen) < FEW_ABOVE // 4:
        return None
    return chosen


def periodogram(samples: Array) -> Array:
    """Squared spectrum of samples (n, c) without their mean, shape (n // 2 + 1, c); of white noise, its variance."""
    return np.abs(_spectrum(samples)) ** 2


def _spectrum(samples: Array) -> npt.NDArray[np.complex128]:
    """Spectrum of samples (n, c) without their mean, shape (n // 2 + 1, c), of which ``periodogram`` is the square."""
    window = np.hanning(len(samples))[:, None]
    spectrum: npt.NDArray[np.complex128] = np.fft.rfft((samples - samples.mean(axis=0)) * window, axis=0)
    spectrum /= np.sqrt(np.sum(window**2))
    return spectrum


def cutoff_for(recording: Recording) -> float:
    """Return the lowest of 3, 6 and 12 Hz that suits the motion of all robots, as far as the rate allows."""
    channel = "pose" if recording.has("pose") else "twist"
    if not recording.has(channel):
        return CUTOFF
    samples = recording.stacked(channel)
    if channel == "pose":
        samples = without_jumps(samples)
    # Places and orientations, or velocities along and about the axes, have units of their own.
    halves = [own[:, part] for own in samples for part in (slice(0, 3), slice(3, None))]
    cutoff = CUTOFF
    while 2.0 * cutoff <= min(_HIGHEST_CUTOFF, HIGHEST * recording.rate) and any(
        _is_fast(half, recording.rate, cutoff, order=2 if channel == "pose" else 0) for half in halves
    ):
        cutoff *= 2.0
    return cutoff


def _is_fast(samples: Array, rate: float, cutoff: float, order: int) -> bool:
    """Whether a filter takes too much of the power of samples (n, c), times the frequency to this order."""
    level = white_level(samples, rate, HIGHEST * rate)
    if level is None:
        return False
    frequency = np.fft.rfftfreq(len(samples), 1.0 / rate)
    used = frequency < 2.0 * cutoff
    weights, ratio = frequency[used] ** order, (frequency[used] / cutoff) ** (2 * ORDER)
    power, noise = weights * (periodogram(samples)[used] - level**2).sum(axis=1), weights * (level**2).sum()
    taken = (ratio / (1.0 + ratio)) ** 2  # its gain is 1 / (1 + ratio)
    unsure = _SURE * float(np.sqrt(np.sum((taken * noise) ** 2)))
    return float(taken @ power) > _FAST * float(power.sum()) + unsure


class Band:
    """Coefficients of the cosine transform of signals, filtered with a cutoff [Hz], up to a frequency.

    Attributes:
        frequency: Frequency of each coefficient, shape (K,) [Hz].
        intervals: Number of intervals in which spectra are measured.
        moving: Number of coefficients in the band in which a load with this twist (n, 6) moves; they come first.
    """

    def __init__(self, signals: Signals, cutoff: float, twist: Array) -> None:
        frequency = np.arange(len(signals.time)) * signals.rate / (2 * len(signals.time))
        self.frequency = frequency[frequency <= _USED * cutoff]
        self._gain = 1.0 / (1.0 + (self.frequency / cutoff) ** (2 * ORDER))
        count = len(self.frequency)
        power = dct(twist - twist.mean(axis=0), axis=0, norm="ortho")[:count] ** 2
        share = np.cumsum((power / np.maximum(power.sum(axis=0), 1e-300)).sum(axis=1))
        self.moving = min(count, int(_WIDER * np.searchsorted(share, _MOTION_POWER * share[-1])) + 3)
        self.intervals = max(_FEWEST, min(_MOST_BANDS, count // _PER_BAND))
        self._starts = np.linspace(0, count, self.intervals + 1).astype(np.intp)[:-1]
        """First coefficient of each interval."""

    def coefficients(self, signals: Array) -> Array:
        """Coefficients (K, ...) of signals (n, ...) as they were before the filter."""
        kept = dct(signals, axis=0, norm="ortho")[: len(self.frequency)]
        return kept / self._gain.reshape(-1, *[1] * (signals.ndim - 1))

    def spread(self, residual: Array) -> Array:
        """Mean square of whitened residuals (K, g, c) in the interval of each coefficient, at least 1, shape (K, g)."""
        sizes = np.diff([*self._starts, len(residual)])
        measured = np.add.reduceat(np.mean(residual**2, axis=-1), self._starts, axis=0) / sizes[:, None]
        return np.repeat(np.maximum(1.0, measured), sizes, axis=0)

    def misfit(self, residual: Array) -> float:
        """-2 log likelihood of whitened residuals (K, g, c) with an unknown spectrum, at least that of noise."""
        spectrum = self.spread(residual)
        return float(np.sum(residual.shape[-1] * np.log(spectrum) + np.sum(residual**2, axis=-1) / spectrum))

    def above(self, residual: Array) -> Array:
        """The part of whitened residuals (K, g, c) that is above the band of the motion."""
        return residual[min(int(_WIDER * self.moving), len(residual)) :]

    def excess(self, residual: Array, unknowns: int) -> tuple[float, float]:
        """Compare whitened residuals (K, g, c) in the band of the motion with noise, or with those above the band.

        Returns:
            By how many deviations they are larger, and their mean square.
        """
        count = residual[: self.moving].size
        inside = float(np.sum(residual[: self.moving] ** 2)) / max(count - unknowns, 1)
        rest = self.above(residual)
        above = float(np.mean(rest**2)) if rest.size > FEW_ABOVE else 1.0
        return (inside / max(1.0, above) - 1.0) * np.sqrt(max(count - unknowns, 1) / 2.0), inside
