"""Curves of one robot over time: how far off it is, and how far off it says that it may be."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from coheft.app.results.judge import RobotReport
from coheft.app.view.geometry import SIGMAS
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.rigid_body.mass_properties import pack_symmetric

WINDOW = 30.0
"""How far curves look back [s]."""
_MOST = 1200
"""Points of a curve at most: robots report about ten times a second."""
_ERRORS = {"mass": 1, "com": 3, "inertia": 3}
"""Curves of each quantity: the mass [kg], the centre of mass along x, y, z [mm], the inertia about x, y, z [kg·m²]."""
_COLUMNS = 1 + sum(_ERRORS.values()) + len(_ERRORS)
"""Time, errors, bands."""


@dataclass(frozen=True, eq=False)
class Curves:
    """Errors of one quantity with their own band.

    Attributes:
        times: (n,) [s].
        errors: (k, n), nan where nothing is known.
        band: Three of the robot's own standard deviations, of the worst axis, (n,); nan where nothing is known.
    """

    times: Array
    errors: Array
    band: Array

    @property
    def limit(self) -> float:
        """Up to where it is worth looking: the present, and most of the past, without its first wild guesses."""
        if not np.isfinite(self.band).any():
            return 1.0
        usual = 3.0 * float(np.nanmedian(self.band))
        recent = [np.abs(values[..., -10:]) for values in (self.errors, self.band)]
        known = np.concatenate([values[np.isfinite(values)] for values in recent])
        return 1.15 * float(np.max([usual, *known.tolist()]))


class Trace:
    """The newest errors of one robot."""

    def __init__(self) -> None:
        self._rows: deque[tuple[float, ...]] = deque(maxlen=_MOST)

    def add(self, report: RobotReport) -> None:
        """Keep one comparison with the truth."""
        mass, com, inertia = report.mass, report.com, report.inertia
        row = np.full(_COLUMNS, np.nan)
        row[0] = report.time_s
        if mass.estimate is not None and mass.std is not None:
            row[1], row[8] = mass.estimate - mass.truth, SIGMAS * mass.std
        if com.estimate is not None and com.std is not None:
            row[2:5] = 1e3 * (np.array(com.estimate) - com.truth)
            row[9] = 1e3 * SIGMAS * max(com.std)
        if inertia.estimate is not None and inertia.std is not None:
            row[5:8] = np.diagonal(np.array(inertia.estimate) - inertia.truth)
            row[10] = SIGMAS * pack_symmetric(np.array(inertia.std))[:3].max()
        self._rows.append(tuple(row.tolist()))
        while self._rows[0][0] < report.time_s - WINDOW:
            self._rows.popleft()

    def curves(self) -> dict[str, Curves]:
        """Curves of ``mass`` [kg], ``com`` [mm] and ``inertia`` [kg·m²]."""
        rows = np.array(self._rows, dtype=np.float64).reshape(-1, _COLUMNS).T
        result, first = {}, 1
        for index, (name, count) in enumerate(_ERRORS.items()):
            result[name] = Curves(rows[0], rows[first : first + count], rows[8 + index])
            first += count
        return result
