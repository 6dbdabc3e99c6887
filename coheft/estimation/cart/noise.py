"""Is a cart's motion measured as well as it is said? Judged from what the measurements themselves show.

Two ways, because neither sees all. Noise that is new in every sample shows in third differences, in which no motion is
left: without any model, at once, and whatever happens to the cart. All else that the model does not know, such as noise
that lasts, or a force that no hand measures, shows in innovations that do not cancel when they are summed.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from coheft.estimation.cart.filter import MOTION_SIZE, Sighting
from coheft.estimation.chi_square import chi_square_threshold
from coheft.estimation.geometry.spatial import Array

KINDS = {
    "position": np.array([0, 1]),
    "heading": np.array([2]),
    "velocity": np.array([3, 4]),
    "turn rate": np.array([5]),
}
"""Components of a motion that one sensor measures."""
RECENT = 200
"""Noise is looked for in so many of the newest samples."""
_LEAST = 24
"""And not in fewer; in so many when there is an alarm."""
_CLEARLY_NEW = 1.5
"""So many times as large noise in the newest samples is another than before."""
_EVERY = 8
"""Nor more often than after so many."""
_CLEAR = 8.0
"""Of ``n`` measured numbers the noise is larger than is said if it looks larger by a share of this over ``sqrt(n)``."""
_GONE = 1.15
"""Noise that is less than so many times what is said counts as gone."""
_MEDIAN = 0.6745
"""Of the absolute value of a standard normal variable."""
_THIRD = np.sqrt(20.0)
"""Standard deviation of a third difference of white noise of standard deviation 1."""
_SUMS = (1, 8, 64)
"""Over so many innovations in a row sums are taken."""
_CHANCE = 1e-6
"""Probability that innovations of a right model are taken for those of a wrong one, by sum and kind."""


class WhiteNoise:
    """How many times as large as is said the noise is that is new in every sample.

    Attributes:
        levels: Of each component, at least 1, shape (6,).
    """

    def __init__(self) -> None:
        self.levels: Array = np.ones(MOTION_SIZE)
        self._motions: deque[Array] = deque(maxlen=RECENT)
        self._since = 0

    @property
    def seen(self) -> int:
        """In how many of the newest measurements noise has been looked for."""
        return len(self._motions)

    def see(self, sighting: Sighting) -> bool:
        """Take in a measurement; whether any level is higher now."""
        self._motions.append(sighting.motion / np.sqrt(np.diag(sighting.covariance)))
        self._since += 1
        if len(self._motions) < _LEAST or self._since < _EVERY:
            return False
        self._since = 0
        before = self.levels
        self.levels = _white_levels(np.array(self._motions), before > 1.0)
        return bool((self.levels > before).any())

    def is_new(self) -> bool:
        """Whether the newest few measurements are so noisy as none before; levels then count with it."""
        if len(self._motions) < _LEAST:
            return False
        newest = _white_levels(np.array(self._motions)[-_LEAST:], np.zeros(MOTION_SIZE, dtype=bool))
        is_new = bool((newest > _CLEARLY_NEW * self.levels).any())
        if is_new:
            self.levels = np.maximum(self.levels, newest)
            kept = list(self._motions)[-_LEAST:]
            self._motions.clear()
            self._motions.extend(kept)
        return is_new


def _white_levels(motions: Array, is_noticed: NDArray[np.bool_]) -> Array:
    """From motions in units of their noise, shape (samples, 6). Medians: jolts and outliers are no noise.

    What is noticed already (6,) stays so until it is nearly gone.
    """
    differences = np.abs(np.diff(motions, 3, axis=0))
    result = np.ones(MOTION_SIZE)
    for components in KINDS.values():
        level = float(np.median(differences[:, components])) / (_MEDIAN * _THIRD)
        if level > (_GONE if is_noticed[components[0]] else 1.0 + _CLEAR / np.sqrt(len(motions) * len(components))):
            result[components] = level
    return result


def misfit(innovations: Array, before: Array) -> Array:
    """How many times as large noise fits the innovations, whose sums vary too much if they are not independent.

    Args:
        innovations: In units of their standard deviations, one after the other, shape (samples, 6).
        before: The same as found before, with which these standard deviations were computed, shape (6,).

    Returns:
        Of each component, at least 1, shape (6,); 1 where it was so before and the difference may be chance.
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
    """In words, what does not fit what is said of measurements.

    Args:
        levels: How many times as large as is said the noise of the motion is, shape (6,).
        unknown_wrench: Standard deviation of a force that the model does not know [N].
    """
    found = [
        f"{kind} is measured {levels[components[0]]:.1f} times as badly as is said"
        for kind, components in KINDS.items()
        if levels[components[0]] > 1.0
    ]
    if unknown_wrench > 0.0:
        found.append(f"the cart is pushed by about {unknown_wrench:.1f} N more or less than is measured")
    return found
