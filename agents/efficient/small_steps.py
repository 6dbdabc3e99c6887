"""Small changes of the mass that the published covariance covers although they have not been noticed yet.

covariance + s^2 D E[x x^T] D^T,    s = standard deviation of the change [kg],    x = 1 kg anywhere in the load

``D`` is the derivative of the error by a step of theta, see ``change.error_by_step``: poses and sensor errors that were
fitted together with one load to rows of two loads are wrong, too.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.change import SmallStep, one_kilogram, spread_mass
from coheft.estimation.moments.fit import Estimate

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

    def after_test(self, found: SmallStep, first: int, share: float) -> UnnoticedStep:
        """Return the step to cover after one more test for small steps.

        Args:
            found: What the test has found, see ``Look.step``.
            first: Number of the first row after that step.
            share: What is left of the present step if the test has not found a larger one.
        """
        faded = share * self.mass
        return UnnoticedStep(found.error, first) if found.error > faded else self._replace(mass=faded)

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
