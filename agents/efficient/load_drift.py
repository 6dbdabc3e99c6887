"""Loads that keep becoming lighter or heavier, such as one that leaks: they stay known, only less certainly.

    theta = former theta + age d,    x^ - x = D d,    ``D`` from ``OneLoad.error_by_drift``

The drift per row ``d`` is so many kilograms, anywhere in the load: the step between two noticed changes, divided by the
rows between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.change import spread_mass
from coheft.estimation.moments.fit import Estimate

_ALIKE = 3.0
"""Two changes of the mass belong to one drift if neither is more than so many times the other."""
_ABRUPT = 10.0
"""A change is abrupt if its statistic exceeds the threshold so many times: that of a drift is noticed on the way."""
_GONE_ON = 3
"""After so many times the rows from one change to the next without another one, the drift has not gone on."""
_PUBLISHED, _KEPT, _STEP = 1.5, 6.0, 2.0
"""Standard deviations of the drift in what is published, and in the next prior, and of a step, as multiples of the last
one. What steps and lags leave wrong adds up, while their variances grow as if they were independent.
"""


class LoadChange(NamedTuple):
    """A change of the load.

    Attributes:
        first: Number of the first row of the new load.
        noticed: Number of the row at which the change was noticed.
        former: Theta before the change, shape (10,).
        surprise: Its statistic over the threshold when it was noticed.
    """

    first: int
    noticed: int
    former: Array
    surprise: float = 1.0


class LoadDrift(NamedTuple):
    """The drift of a load.

    Attributes:
        step: Change of the mass from one load to the next [kg].
        rows: Number of rows in which it has changed so.
        first: Number of the first of these rows.
    """

    step: float
    rows: int
    first: int

    @staticmethod
    def of(changes: Sequence[LoadChange], mass: float, newest: int, longest: int) -> LoadDrift | None:
        """The drift of the present load: the newest step that is followed by a similar one; None if there is none.

        A step is the change of the mass from just before one change to just before the next one, or to now. Abrupt
        changes are skipped, because the step across them is not known. One more step that is not similar is skipped.

        Args:
            changes: Load changes so far, oldest first.
            mass: The mass now [kg].
            newest: Number of the newest row.
            longest: Loads that change after more rows do not drift, nor does one that has not changed gradually since.
        """
        masses = [*(change.former[0] for change in changes), mass]
        steps = [float(after - before) for before, after in pairwise(masses)]
        gradual = [index for index, change in enumerate(changes) if change.surprise <= _ABRUPT]
        for index, following in reversed(list(pairwise(gradual))[-2:]):
            rows = changes[index + 1].first - changes[index].first
            drift = LoadDrift(steps[index], max(1, rows), changes[index].first)
            has_stopped = newest - changes[gradual[-1]].first > longest
            if rows <= longest and not has_stopped and drift.goes_on(steps[following], newest - changes[-1].first):
                return drift
        return None

    def goes_on(self, change: float, rows: int) -> bool:
        """Whether the mass has changed alike by ``change`` [kg] since, in so many rows."""
        square = self.step**2
        return square / _ALIKE < change * self.step < square * _ALIKE and rows <= _GONE_ON * self.rows

    def process_noise(self, now: Estimate, error_by_drift: Array) -> Array:
        """Covariance (u, u) of the difference between a fit to the rows before another step and theta after it;
        ``error_by_drift`` is the ``D`` of that fit, shape (u, 10).
        """
        theta, noise = now.body.unknowns.theta, spread_mass(now)
        result: Array = (_KEPT * self.step / self.rows) ** 2 * error_by_drift @ noise @ error_by_drift.T
        result[theta, theta] += (_STEP * self.step) ** 2 * noise
        return result

    def cover(self, estimate: Estimate, error_by_drift: Array) -> Estimate:
        """Return an estimate whose covariance covers the drift; ``error_by_drift`` is its ``D``, shape (u, 10)."""
        noise = error_by_drift @ spread_mass(estimate) @ error_by_drift.T
        return estimate.with_process_noise((_PUBLISHED * self.step / self.rows) ** 2 * noise)
