"""The cutoff of the filter that the motion of a load needs.

Filters reduce fast parts of a motion, and of the forces that go with it, but not in proportion: forces depend on
products of velocities. So a motion has to be slower than the filter.
"""

import numpy as np

from coheft.estimation.batch.judge.band import HIGHEST, periodogram, white_level
from coheft.estimation.batch.recording import Recording
from coheft.estimation.batch.signals import CUTOFF, ORDER, without_jumps
from coheft.estimation.geometry.spatial import Array

_HIGHEST_CUTOFF = 12.0
"""No robot moves a load so fast that it needs a higher one [Hz]."""
_FAST = 1e-4
"""Share of the power of velocities that a filter may take away."""
_SURE = 6.0
"""Standard deviations by which noise may exceed its mean."""


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
