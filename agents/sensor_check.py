"""Blocks of samples that no working sensor gives: the robot finds them by itself, and does not use them."""

from __future__ import annotations

import numpy as np

from coheft.estimation.measurement import SensorNoise
from coheft.estimation.spatial import Array

_SENSORS = ("gyro", "velocity", "accelerometer", "force", "torque")
_OUTLIER = 12.0
"""A sample that differs by more standard deviations from both its neighbours, on the same side, is an outlier. What
really changes at a sudden differs from one of them only. The last one of a block has one neighbour: it is an outlier if
it is so far from where the two before it point,"""
_UNUSUAL = 3.0
"""and so many times as far as any other of the block."""


class SensorCheck:
    """Looks at one robot's samples.

    Args:
        noise: Of its sensors.

    Attributes:
        fault: What has been wrong with the last two blocks, None if one of them was right.
    """

    def __init__(self, noise: SensorNoise) -> None:
        self._deviations = noise.per_column()
        self._last = np.empty((0, len(self._deviations)))
        self._before = True
        self.fault: str | None = None

    def work(self, samples: Array) -> bool:
        """Whether a block of samples (B, 15) can be used."""
        found = self._find(np.vstack([self._last, samples]))
        self.fault = None if self._before else found
        self._before = found is None
        self._last = samples[-1:]
        return found is None

    def _find(self, samples: Array) -> str | None:
        for k, sensor in enumerate(_SENSORS):
            columns = slice(3 * k, 3 * k + 3)
            what = _fault(samples[:, columns], self._deviations[columns])
            if what is not None:
                return f"the {sensor} {what}"
        return None


def _fault(samples: Array, deviations: Array) -> str | None:
    """What is wrong with samples of one sensor (n, 3), the last one of the block before first."""
    if not np.isfinite(samples).all():
        return "is not a finite number"
    steps = np.diff(samples, axis=0)
    # Noise does not repeat: what stays as it is, or at its largest value, for half of the samples does not measure.
    if 2 * np.count_nonzero(~steps.any(axis=1)) >= len(steps) and samples.any():
        return "is frozen"
    for limits in (samples.min(axis=0), samples.max(axis=0)):
        at_limit = 2 * np.count_nonzero(samples == limits, axis=0) > len(samples)
        if np.any(at_limit & (limits != 0.0)):
            return "is saturated"
    scaled = steps / deviations
    peaks = np.minimum(np.abs(scaled[:-1]), np.abs(scaled[1:])) * (scaled[:-1] * scaled[1:] < 0.0)
    bends = np.abs(np.diff(scaled, axis=0))
    is_last_far = bends[-1:] > np.maximum(_OUTLIER, _UNUSUAL * bends[:-1].max(axis=0, initial=0.0))
    if np.any(peaks > _OUTLIER) or np.any(is_last_far):
        return "has outliers"
    return None
