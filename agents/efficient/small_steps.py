"""Small changes of the mass that the published covariance covers although they have not been noticed yet.

covariance + s^2 D E[x x^T] D^T,    s = standard deviation of the change [kg],    x = 1 kg anywhere in the load

``D`` is the derivative of the error by a step of theta, see ``change.error_by_step``: poses and sensor errors that were
fitted together with one load to rows of two loads are wrong, too.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coheft.agents.efficient.settings import Guards
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.change import SmallStep, StepThresholds, one_kilogram, spread_mass
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.unknowns import THETA

_COVER = 0.5
"""Standard deviation that is added, as a share of the possible step; five of them exceed the step."""
_LEAST_LEFT = 0.2
"""The mass is taken to be wrong by at least this share of a step."""


class UnnoticedStep(NamedTuple):
    """A step of the mass that may have occurred without having been noticed yet.

    Attributes:
        mass: By how much the estimate of the mass may be off [kg].
        first: Number of the first row after the step.
    """

    mass: float = 0.0
    first: int = 0

    def process_noise(self, estimate: Estimate, error_by_step: Array) -> Array:
        """Covariance (u, u) of the error that the step makes; ``error_by_step`` is ``D``, shape (u, 10)."""
        by_step = error_by_step.copy()
        if not _wrong_share(estimate, error_by_step) > _LEAST_LEFT:  # a fit to later rows only: it may have been later
            by_step[estimate.body.unknowns.theta] = -_LEAST_LEFT * np.eye(by_step.shape[1])
        result: Array = by_step @ self.covariance(estimate, error_by_step) @ by_step.T
        return result

    def covariance(self, estimate: Estimate, error_by_step: Array) -> Array:
        """Covariance (10, 10) of the step of theta itself; arguments as for ``process_noise``."""
        deviation = _COVER * self.mass / max(_LEAST_LEFT, _wrong_share(estimate, error_by_step))
        return deviation**2 * spread_mass(estimate)


NO_STEP = UnnoticedStep()


def _wrong_share(estimate: Estimate, error_by_step: Array) -> float:
    """By which share of a step at the centre of mass the estimate of the mass is wrong."""
    error = error_by_step[estimate.body.unknowns.theta.start] @ one_kilogram(estimate.state.fitted_load)
    return -float(error)


class StepWatch:
    """Remembers the largest step that tests for a change have found.

    Args:
        shortest: Rows after which a step counts as long ago.
        guards: Thresholds.

    Attributes:
        step: The step.
    """

    def __init__(self, shortest: int, guards: Guards) -> None:
        self._shortest, self._guards, self.step = shortest, guards, NO_STEP

    def begin(self) -> None:
        """Start again with other knowledge."""
        self.step = NO_STEP

    def sought(self, estimate: Estimate) -> StepThresholds:
        """Which steps a test for a change has to look for."""
        guards, mass = self._guards, float(estimate.state.fitted_load[THETA.start])
        return StepThresholds(self._shortest, guards.least_small_step, guards.least_recent_step, mass)

    def take(self, found: SmallStep | None, number: int) -> None:
        """Process what such a test has found, see ``Look.step``; the step is before the row of this number."""
        if found is None:
            return
        faded = self._guards.small_step_fades * self.step.mass
        self.step = UnnoticedStep(found.error, number) if found.error > faded else self.step._replace(mass=faded)
