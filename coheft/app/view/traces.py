"""Errors of one robot over time, with its own standard deviations."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from coheft.app.results.errors import PAYLOAD_SIZE
from coheft.app.results.points import Point
from coheft.app.view.geometry import SIGMAS
from coheft.estimation.geometry.spatial import Array

WINDOW = 30.0
"""Time that curves cover [s]."""
_MOST = 1200
"""Largest number of points of a curve; robots report about ten times a second."""
_PARTS = {"mass": (slice(0, 1), 1.0), "com": (slice(1, 4), 1e3), "inertia": (slice(4, 7), 1.0)}
"""Elements of ``(m, h, J packed)`` of each quantity, and a factor: kg, mm along x, y, z, kg·m² about x, y, z."""


@dataclass(frozen=True, eq=False)
class Curves:
    """Errors of one quantity with their band.

    Attributes:
        times: (n,) [s].
        errors: (k, n), NaN where nothing is known.
        band: Three of the robot's own standard deviations, of the worst axis, (n,); NaN where nothing is known.
    """

    times: Array
    errors: Array
    band: Array

    @property
    def limit(self) -> float:
        """Limit of the vertical axis: covers the present and most of the past, but not the first estimates."""
        if not np.isfinite(self.band).any():
            return 1.0
        usual = 3.0 * float(np.nanmedian(self.band))
        recent = [np.abs(values[..., -10:]) for values in (self.errors, self.band)]
        known = np.concatenate([values[np.isfinite(values)] for values in recent])
        return 1.15 * float(np.max([usual, *known.tolist()]))


class Trace:
    """The newest errors of one robot."""

    def __init__(self) -> None:
        self._points: deque[Point] = deque(maxlen=_MOST)

    def add(self, point: Point) -> None:
        """Add one comparison with the truth."""
        self._points.append(point)
        while self._points[0].time < point.time - WINDOW:
            self._points.popleft()

    def curves(self) -> dict[str, Curves]:
        """Return the curves of ``mass`` [kg], ``com`` [mm] and ``inertia`` [kg·m²]."""
        times = np.array([point.time for point in self._points])
        rows = np.array([(-point.error, SIGMAS * point.std) for point in self._points]).reshape(-1, 2, PAYLOAD_SIZE)
        found = {name: factor * rows[..., part] for name, (part, factor) in _PARTS.items()}
        return {name: Curves(times, part[:, 0].T, part[:, 1].max(axis=1)) for name, part in found.items()}
