"""Compliant grasps: the hand is displaced against the load by ``compliance x force``, without a delay of its own."""

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import ACCELERATION, FORCE, GYRO, VELOCITY

_PAST = 4
"""Samples that two derivatives from samples before need."""


class CompliantGrasps:
    """What compliance adds to the motion of N robots' hands.

    Args:
        compliances: Shape (N,) [m/N].
        rate: Samples per second.
    """

    def __init__(self, compliances: Array, rate: float) -> None:
        self._compliances, self._rate = compliances[:, None, None], rate
        self._past = np.full((len(compliances), _PAST, 15), np.nan)

    def begin_anew(self, robot: int) -> None:
        """The force of this robot jumps before the next block: it lets go, takes hold, or slips."""
        self._past[robot] = np.nan

    def displaced(self, exact: Array) -> Array:
        """What exact sensors read at the displaced hands, from what they would read at stiff ones, (N, B, 15)."""
        if not self._compliances.any():
            return exact
        known = np.concatenate([np.where(np.isnan(self._past), exact[:, :1], self._past), exact], axis=1)
        self._past = known[:, -_PAST:]
        w = known[..., GYRO]
        velocity = self._changing(self._compliances * known[..., FORCE], w)
        result = exact.copy()
        result[..., VELOCITY] += velocity[:, 2:]
        result[..., ACCELERATION] += self._changing(velocity, w[:, 2:])
        return result

    def _changing(self, vectors: Array, w: Array) -> Array:
        """How fast vectors (N, n, 3) change in axes that do not turn, at all but the first two, shape (N, n - 2, 3)."""
        rates = self._rate * (1.5 * vectors[:, 2:] - 2.0 * vectors[:, 1:-1] + 0.5 * vectors[:, :-2])
        return rates + np.cross(w[:, 2:], vectors[:, 2:])
