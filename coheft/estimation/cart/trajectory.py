"""Reference trajectories of a cart.

Speed and turn rate are linear between knots, so that all trajectories begin and end with a step of the acceleration
(Aguilera et al., fig. 3).
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from coheft.estimation.geometry.spatial import Array

_STEP = 1e-3
"""Step of the integration [s]."""


@dataclass(frozen=True)
class Target:
    """Reference motion at one time.

    Attributes:
        pose: ``q_d``, shape (3,) [m, m, rad].
        speed: Forward speed [m/s].
        turn_rate: Turn rate [rad/s].
        acceleration: Forward acceleration [m/s²].
        turn_acceleration: Angular acceleration [rad/s²].
    """

    pose: Array
    speed: float
    turn_rate: float
    acceleration: float
    turn_acceleration: float


@dataclass(frozen=True)
class Trajectory:
    """A trajectory; it ends with the last knot.

    Attributes:
        speeds: Knots ``(time, speed)`` [s, m/s].
        turn_rates: Knots ``(time, turn rate)`` [s, rad/s].
    """

    speeds: tuple[tuple[float, float], ...]
    turn_rates: tuple[tuple[float, float], ...] = ((0.0, 0.0),)

    def at(self, time: float) -> Target:
        """Reference motion at a time [s]; after the end, at rest."""
        if time >= self._end:
            return Target(self._poses[-1], 0.0, 0.0, 0.0, 0.0)
        speed, acceleration = _interpolate(self.speeds, time)
        turn_rate, turn_acceleration = _interpolate(self.turn_rates, time)
        index = min(max(time, 0.0) / _STEP, len(self._poses) - 1.0)
        low = min(int(index), len(self._poses) - 2)
        pose = self._poses[low] + (index - low) * (self._poses[low + 1] - self._poses[low])
        return Target(pose, speed, turn_rate, acceleration, turn_acceleration)

    @property
    def _end(self) -> float:
        """Time of the end [s]."""
        return max(self.speeds[-1][0], self.turn_rates[-1][0])

    @cached_property
    def _poses(self) -> Array:
        """Poses at all steps of the integration, by the midpoint rule, shape (steps + 1, 3)."""
        middles = (np.arange(round(self._end / _STEP)) + 0.5) * _STEP
        speeds = np.interp(middles, *np.transpose(self.speeds))
        turn_rates = np.interp(middles, *np.transpose(self.turn_rates))
        headings = np.concatenate([[0.0], np.cumsum(turn_rates) * _STEP])
        between = 0.5 * (headings[:-1] + headings[1:])
        steps = np.stack([speeds * np.cos(between), speeds * np.sin(between), turn_rates], axis=1) * _STEP
        return np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])


def _interpolate(knots: tuple[tuple[float, float], ...], time: float) -> tuple[float, float]:
    """Value and slope between knots; constant outside."""
    for (begin, low), (end, high) in pairwise(knots):
        if begin <= time < end:
            slope = (high - low) / (end - begin)
            return low + slope * (time - begin), slope
    return (knots[0] if time < knots[0][0] else knots[-1])[1], 0.0


_SPEEDS = ((0.5, 0.0), (3.0, 2.0), (27.5, 2.0), (30.0, 0.0))

STRAIGHT = Trajectory(_SPEEDS)
"""Trajectory 1."""

CURVES = Trajectory(
    _SPEEDS,
    (
        (7.0, 0.0), (8.0, 0.35), (11.0, 0.35), (12.0, 0.0),
        (16.0, 0.0), (17.0, -0.35), (20.0, -0.35), (21.0, 0.0),
        (25.0, 0.0), (26.0, 0.35), (29.0, 0.35), (30.0, 0.0),
    ),
)  # fmt: skip
"""Trajectory 2: large curves that begin at 7, 16 and 25 s."""

THERE_AND_BACK = Trajectory(
    ((0.5, 0.0), (2.5, 1.0), (8.5, 1.0), (12.5, -1.0), (17.5, -1.0), (21.5, 1.0), (28.0, 1.0), (30.0, 0.0))
)
"""Pushing, pulling, pushing: casters have to turn round at 10.5 s and 19.5 s."""

TRAJECTORIES = {"straight": STRAIGHT, "curves": CURVES, "there and back": THERE_AND_BACK}
