"""Errors of one robot over time, with its own standard deviations."""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from coheft.app.results.judge import RobotReport
from coheft.app.view.geometry import SIGMAS
from coheft.estimation.geometry.spatial import Array

WINDOW = 30.0
"""Time that curves cover [s]."""
_MOST = 1200
"""Largest number of points of a curve; robots report about ten times a second."""
_COLUMNS = {"mass": slice(1, 3), "com": slice(3, 7), "inertia": slice(7, 11)}
"""Columns of each quantity after the time: mass [kg], centre of mass [mm] along x, y, z, inertia [kg·m²] about x, y, z;
the last column of each is its band."""


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
        self._rows: deque[Array] = deque(maxlen=_MOST)

    def add(self, report: RobotReport) -> None:
        """Add one comparison with the truth."""
        com, inertia = report.com, report.inertia
        errors = (
            _errors(report.mass.truth, report.mass.estimate, report.mass.std),
            1e3 * _errors(com.truth, com.estimate, com.std),
            _errors(*(None if m is None else np.diagonal(m) for m in (inertia.truth, inertia.estimate, inertia.std))),
        )
        self._rows.append(np.concatenate([[report.time_s], *errors]))
        while self._rows[0][0] < report.time_s - WINDOW:
            self._rows.popleft()

    def curves(self) -> dict[str, Curves]:
        """Return the curves of ``mass`` [kg], ``com`` [mm] and ``inertia`` [kg·m²]."""
        rows = np.array(self._rows).reshape(-1, _COLUMNS["inertia"].stop).T
        return {name: Curves(rows[0], rows[own][:-1], rows[own][-1]) for name, own in _COLUMNS.items()}


def _errors(truth: ArrayLike | None, estimate: ArrayLike | None, std: ArrayLike | None) -> Array:
    """Return the errors of a quantity, then the band of the worst axis, shape (k + 1,); NaN if it is not known."""
    true = np.atleast_1d(np.asarray(truth, dtype=np.float64))
    if estimate is None or std is None:
        return np.full(len(true) + 1, np.nan)
    return np.append(np.asarray(estimate) - true, SIGMAS * np.max(std))
