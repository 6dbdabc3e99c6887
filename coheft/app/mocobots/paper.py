"""Errors of Zhang et al. (2025) on hardware, Tables II to V.

Errors of rotations, positions, mass and centre of mass are means of absolute values. Those of principal inertias are
means of signed values with standard deviations, so that ``sqrt(mean² + std²)`` is used.
"""

import numpy as np

_Three = tuple[float, float, float]
PAIRS = ((0, 1), (1, 2), (2, 0))
"""Pairs of robots, in the order of the tables."""
ROWS = (
    *("rotation 12, °", "rotation 23, °", "rotation 31, °", "position 12, mm", "position 23, mm", "position 31, mm"),
    *("mass, kg", "centre of mass, mm", "inertia 1, %", "inertia 2, %", "inertia 3, %"),
)


def _rows(
    rotations: _Three, positions: _Three, mass: float, com: float, principal: _Three, principal_std: _Three
) -> tuple[float, ...]:
    return (*rotations, *positions, mass, com, *np.hypot(principal, principal_std).tolist())


PAPER = {
    "a": _rows((0.94, 0.99, 1.07), (7, 42, 51), 0.11, 21, (3.6, 4.1, 1.8), (1.6, 0.7, 3.0)),
    "b": _rows((1.77, 0.90, 1.93), (16, 39, 39), 0.07, 18, (3.1, 2.5, 4.4), (3.0, 3.0, 1.0)),
    "c": _rows((0.66, 2.21, 1.67), (38, 46, 63), 0.11, 39, (0.3, 1.6, 3.8), (4.0, 4.9, 2.2)),
    "d": _rows((2.55, 3.57, 1.49), (19, 57, 29), 0.18, 23, (2.8, 0.8, 0.1), (3.4, 2.8, 4.4)),
}
"""Errors in the order of ``ROWS``, by configuration."""
