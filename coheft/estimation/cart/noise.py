"""Tests whether the noise of a cart's measurements is larger than stated.

White noise shows in third differences, in which no motion is left: at once, without a model, whatever happens to the
cart. Other errors of the model, such as correlated noise or a force that no hand measures, show in sums of innovations
that are too large.
"""

from collections import deque

import numpy as np

from coheft.estimation.cart.filter import MOTION_SIZE, MotionMeasurement
from coheft.estimation.chi_square import chi_square_threshold
from coheft.estimation.geometry.spatial import Array

KINDS = {
    "position": np.array([0, 1]),
    "heading": np.array([2]),
    "velocity": np.array([3, 4]),
    "turn rate": np.array([5]),
}
"""Components of a motion, by sensor."""
RECENT = 200
"""Number of newest samples in which white noise is estimated,"""
LEAST = 24
"""and the least number, which is used after an alarm."""
_CLEARLY_NEW = 1.5
"""Ratio of the newest noise to the previous level from which on it is new."""
_EVERY = 8
"""Number of samples between two estimates."""
_CLEAR = 8.0
"""The noise of ``n`` numbers is larger than stated if its estimate is, relatively, by more than this / ``sqrt(n)``."""
_RISEN = 1.2
"""Ratio of the newest noise to the lowest level since the last rise from which on it has risen: less may be chance."""
_MEDIAN = 0.6745
"""Median of the absolute value of a standard normal variable."""
_THIRD = np.sqrt(20.0)
"""Standard deviation of a third difference of white noise of standard deviation 1."""
_SUMS = (1, 8, 64)
"""Numbers of consecutive innovations that are summed."""
_CHANCE = 1e-6
"""Probability of a false alarm per sum and sensor."""


class WhiteNoise:
    """White noise of each component in multiples of the stated one, at least 1: ``levels``, shape (6,)."""

    def __init__(self) -> None:
        self.levels: Array = np.ones(MOTION_SIZE)
        self._lowest = self.levels
        self._motions: deque[Array] = deque(maxlen=RECENT)
        self._since = 0

    @property
    def seen(self) -> int:
        """Number of newest measurements in which noise is estimated."""
        return len(self._motions)

    def see(self, measurement: MotionMeasurement) -> bool:
        """Add a measurement; return whether any level has risen clearly."""
        self._motions.append(measurement.motion / np.sqrt(np.diag(measurement.covariance)))
        self._since += 1
        if len(self._motions) < LEAST or self._since < _EVERY:
            return False
        self._since = 0
        self.levels = _white_levels(np.array(self._motions))
        has_risen = bool((self.levels > _RISEN * self._lowest).any())
        self._lowest = self.levels if has_risen else np.minimum(self._lowest, self.levels)
        return has_risen

    def is_new(self) -> bool:
        """Whether the newest few measurements are noisier than before; levels then rise."""
        if len(self._motions) < LEAST:
            return False
        newest = _white_levels(np.array(self._motions)[-LEAST:])
        is_new = bool((newest > _CLEARLY_NEW * self.levels).any())
        if is_new:
            self.levels = np.maximum(self.levels, newest)
            kept = list(self._motions)[-LEAST:]
            self._motions.clear()
            self._motions.extend(kept)
        return is_new


def _white_levels(motions: Array) -> Array:
    """Levels from motions in units of their noise, shape (samples, 6), by medians: jolts and outliers are no noise."""
    differences = np.abs(np.diff(motions, 3, axis=0))
    result = np.ones(MOTION_SIZE)
    for components in KINDS.values():
        level = float(np.median(differences[:, components])) / (_MEDIAN * _THIRD)
        if level > 1.0 + _CLEAR / np.sqrt(len(motions) * len(components)):
            result[components] = level
    return result


def misfit(innovations: Array, before: Array) -> Array:
    """Noise of each component that explains the innovations and their sums, in multiples of the stated one, shape (6,).

    It is at least 1, and stays 1 where the difference may be chance. The consecutive innovations, shape (samples, 6),
    are in units of the standard deviations that were computed with the result ``before``, shape (6,).
    """
    found = np.zeros(MOTION_SIZE)
    for length in _SUMS:
        count = len(innovations) // length
        if count == 0:
            continue
        sums = innovations[len(innovations) - count * length :].reshape(count, length, MOTION_SIZE).sum(axis=1)
        for components in KINDS.values():
            freedom = count * len(components)
            total = float(np.square(sums[:, components]).sum()) / length
            is_more = total > chi_square_threshold(freedom, _CHANCE)
            found[components] = np.maximum(
                found[components], total / freedom if is_more or before[components[0]] > 1.0 else 1.0
            )
    return np.maximum(before * np.sqrt(found), 1.0)


def doubts(levels: Array, unknown_wrench: float) -> list[str]:
    """Describe what is worse than stated: noise of the motion in multiples of that, shape (6,), and an unknown force
    [N].
    """
    found = [
        f"the noise of the {kind} is {levels[components[0]]:.1f} times as large as stated"
        for kind, components in KINDS.items()
        if levels[components[0]] > 1.0
    ]
    if unknown_wrench > 0.0:
        found.append(f"an unknown force of about {unknown_wrench:.1f} N acts on the cart")
    return found
