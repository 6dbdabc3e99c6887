"""Small changes of the mass that the published covariance covers although they have not been noticed yet.

covariance of theta + s^2 E[x x^T],    s = standard deviation of the change [kg],    x = 1 kg anywhere in the load
"""

from __future__ import annotations

from coheft.agents.efficient.settings import Guards
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.change import SmallSteps, spread_mass
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.unknowns import THETA

_COVER = 0.5
"""Standard deviation that is added, as a share of the possible step; five of them exceed the step."""


class UnnoticedStep:
    """The step of the mass that may have occurred without having been noticed yet.

    Args:
        shortest: Rows after which a step counts as long ago.
        guards: Thresholds.

    Attributes:
        mass: By how much the estimate of the mass may be off [kg].
    """

    def __init__(self, shortest: int, guards: Guards) -> None:
        self._shortest, self._guards = shortest, guards
        self.mass = 0.0

    def sought(self, estimate: Estimate) -> SmallSteps | None:
        """Which steps a test for a change has to look for; None without a load."""
        load = estimate.state.load
        if load is None:
            return None
        return SmallSteps(
            self._shortest, self._guards.least_small_step, self._guards.least_recent_step, load[THETA.start]
        )

    def take(self, found: float | None) -> None:
        """Process what such a test has found, see ``Look.step``."""
        if found is not None:
            self.mass = max(found, self._guards.small_step_fades * self.mass)

    def process_noise(self, estimate: Estimate) -> Array | None:
        """Covariance (10, 10) by which theta may have changed, None if it has not."""
        load = estimate.state.load
        if load is None or self.mass == 0.0:
            return None
        result: Array = (_COVER * self.mass) ** 2 * spread_mass(load[THETA], estimate.size)
        return result

    def cover(self, estimate: Estimate) -> Estimate:
        """Return an estimate whose covariance covers the step."""
        noise = self.process_noise(estimate)
        return estimate if noise is None else estimate.with_process_noise(estimate.body.unknowns.theta, noise)
