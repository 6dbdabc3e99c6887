"""Small changes of the mass that the published covariance covers although they have not been noticed yet.

covariance of theta + s^2 E[x x^T],    s = standard deviation of the change [kg],    x = 1 kg anywhere in the load
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from coheft.agents.efficient.settings import Guards
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.change import SmallSteps, spread_mass
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.unknowns import THETA

_COVER = 0.5
"""Standard deviation that is added, as a share of the possible step; five of them exceed the step."""
_ALIKE = 3.0
"""Two changes of the mass belong to one drift if neither is more than so many times the other."""
_NOT_YET, _SINCE = 0.25, 0.5
"""Standard deviation of a drift, as shares of its last step: at once, and after the time from one step to the next."""


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


def cover_drift(estimate: Estimate, changes: Sequence[LoadChange], rows: int, longest: int) -> Estimate:
    """Return an estimate whose covariance covers the drift of a load that keeps becoming lighter or heavier.

    It may have moved on as far as with the last change, in proportion to the time since.

    Args:
        estimate: The estimate.
        changes: Load changes so far, oldest first.
        rows: Number of rows of the present load.
        longest: Loads that change after more rows do not drift.
    """
    load = estimate.state.load
    if len(changes) < 2 or load is None:
        return estimate
    second_last, last = changes[-2:]
    step, change = last.former - second_last.former, load[THETA] - last.former
    gap = max(1, last.first - second_last.first)
    # After three times the gap without another change it has not gone on.
    is_drift = step[0] ** 2 / _ALIKE < change[0] * step[0] < step[0] ** 2 * _ALIKE
    if not is_drift or gap > longest or rows > 3 * gap:
        return estimate
    spread = (_NOT_YET + _SINCE * rows / gap) * change
    theta, seen = estimate.body.unknowns.theta, estimate.seen.copy()
    seen[theta, theta] += np.outer(spread, spread)
    return replace(estimate, seen=seen)
