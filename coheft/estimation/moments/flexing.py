"""How fast a force changes in axes that do not turn: with it a compliant grasp moves against the load.

    displacement = c f,    velocity = c u1,    acceleration = c u2,        u1 = df/dt + w x f,    u2 = du1/dt + w x u1

``u1, u2`` are derivatives of a least-squares polynomial of fourth degree through the forces of a row and of some time
before and after it, turned into the axes of the row's middle by the gyro. A constant of the row's own is fitted beside
it, so their noise is independent of that of the row's mean force, with which they are multiplied in moments.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from coheft.estimation.geometry.spatial import Array, rotation_exp
from coheft.estimation.measurement import FORCE, GYRO

FLEXING_SIZE = 6
_MARGIN, _DEGREE = 0.06, 4
"""Time before and after a row of which forces are used [s], and the degree: up to 3 Hz this is right to 0.2 %, and with
0.02 mm/N the noise of forces is a quarter of that of the accelerometer. A parabola would be off by 4 % at 1.6 Hz."""


def flexing_margin(rate: float) -> int:
    """Samples before and after a row of which forces are used."""
    return max(3, round(_MARGIN * rate))


def flexing(samples: Array, margin: int, rate: float) -> Array:
    """How fast the force changes in a row.

    Args:
        samples: Of the row, and ``margin`` more before and after it, shape (B + 2 margin, 15).
        margin: See ``flexing_margin``.
        rate: Samples per second.

    Returns:
        ``(u1, u2)`` in the axes of the row's middle, shape (6,) [N/s, N/s²].
    """
    steps = (samples[1:, GYRO] + samples[:-1, GYRO]) / (2.0 * rate)
    turned = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    middle = (len(samples) - 1) // 2
    turned -= 0.5 * (turned[middle] + turned[len(samples) - 1 - middle])
    forces = (rotation_exp(turned) @ samples[:, FORCE, None])[..., 0]
    result: Array = flexing_weights(len(samples) - 2 * margin, margin, rate) @ forces
    return result.ravel()


@cache
def flexing_weights(row: int, margin: int, rate: float) -> Array:
    """Weights of forces in ``u1`` and in ``u2``, shape (2, row + 2 margin)."""
    count = row + 2 * margin
    half = 0.5 * (count - 1)
    times = np.arange(count) / half - 1.0
    is_own = (np.arange(count) >= margin) & (np.arange(count) < margin + row)
    coefficients = np.linalg.pinv(np.column_stack([np.vander(times, _DEGREE + 1, increasing=True), is_own]))
    weights: Array = coefficients[1:3] * np.array([[rate / half], [2.0 * (rate / half) ** 2]])
    return weights
