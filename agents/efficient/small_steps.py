"""Small changes of the mass that the published covariance covers although they have not been noticed yet.

covariance of theta + s^2 E[x x^T],    s = standard deviation of the change [kg],    x = 1 kg anywhere in the load
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from coheft.agents.efficient.settings import Guards
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.change import SmallSteps, spread_mass
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.unknowns import THETA

_COVER = 0.5
"""Standard deviation that is added, as a share of the possible step; five of them exceed the step."""
_ALIKE = 3.0
"""Two changes of the mass belong to one drift if neither is more than so many times the other."""
COVER = 1.5


class UnnoticedStep:
    """The step of the mass that may have occurred without having been noticed yet.

    Args:
        shortest: Least number of rows since the step.
        guards: Thresholds.

    Attributes:
        mass: By how much the estimate of the mass may be off [kg].
    """

    def __init__(self, shortest: int, guards: Guards) -> None:
        self._shortest, self._significant, self._fades = shortest, guards.least_small_step, guards.small_step_fades
        self.mass = 0.0

    def sought(self, estimate: Estimate) -> SmallSteps | None:
        """Which steps a test for a change has to look for; None without a load."""
        load = estimate.state.load
        return None if load is None else SmallSteps(self._shortest, self._significant, load[THETA.start])

    def take(self, found: float | None) -> None:
        """Process what such a test has found, see ``Look.step``."""
        if found is not None:
            self.mass = max(found, self._fades * self.mass)

    def cover(self, estimate: Estimate) -> Estimate:
        """Return an estimate whose covariance covers the step."""
        load, theta = estimate.state.load, estimate.body.unknowns.theta
        if load is None or self.mass == 0.0:
            return estimate
        seen = estimate.seen.copy()
        seen[theta, theta] += (_COVER * self.mass) ** 2 * spread_mass(load[THETA], estimate.size)
        return replace(estimate, seen=seen)


class LoadChange(NamedTuple):
    """A change of the load.

    Attributes:
        first: Number of the first row of the new load.
        noticed: Number of the row at which the change was noticed.
        former: Theta before the change, shape (10,).
    """

    first: int
    noticed: int
    former: Array


def drift_rate(changes: Sequence[LoadChange], mass: float, rows: int, longest: int) -> float:
    """Return by how much a load that keeps becoming lighter or heavier drifts per row [kg]; zero if it does not.

    Args:
        changes: Load changes so far, oldest first.
        mass: Of the present load [kg].
        rows: Number of rows of the present load.
        longest: Loads that change after more rows do not drift.
    """
    if len(changes) < 2:
        return 0.0
    second_last, last = changes[-2:]
    step, change = last.former[0] - second_last.former[0], mass - last.former[0]
    gap = max(1, last.first - second_last.first)
    # After three times the gap without another change it has not gone on.
    is_drift = step**2 / _ALIKE < change * step < step**2 * _ALIKE
    return abs(float(step)) / gap if is_drift and gap <= longest and rows <= 3 * gap else 0.0


def drift_step(changes: Sequence[LoadChange], longest: int) -> float:
    """Return by how much the mass changed last [kg] if the newest change may continue that drift, else zero.

    Args:
        changes: Load changes so far, oldest first; the load after the newest one is not known yet.
        longest: Loads that change after more rows do not drift.
    """
    if len(changes) < 2 or changes[-1].first - changes[-2].first > longest:
        return 0.0
    return abs(float(changes[-1].former[0] - changes[-2].former[0]))


def cover_drift(estimate: Estimate, rate: float, response: Array) -> Estimate:
    """Return an estimate whose covariance covers a drift.

    Args:
        estimate: The estimate.
        rate: Drift per row [kg].
        response: By how much the estimate of theta is off per drift of theta by one per row, shape (10, 10).
    """
    load, theta = estimate.state.load, estimate.body.unknowns.theta
    assert load is not None
    seen = estimate.seen.copy()
    seen[theta, theta] += (COVER * rate) ** 2 * response @ spread_mass(load[THETA], estimate.size) @ response.T
    return replace(estimate, seen=seen)
