"""Small changes of the mass: the published covariance covers them, and they do not discard what is known of the load.

covariance of theta + (c s)^2 x x^T + the same about the other axes,    s = a step [kg], x = 1 kg at the centre of mass
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from coheft.agents.efficient.settings import Guards
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.change import mass_step, surprise
from coheft.estimation.moments.chapter import spread_mass
from coheft.estimation.moments.evidence import Evidence
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.unknowns import THETA

_COVER = 0.5
"""One standard deviation, as a share of a step that may or may not have occurred: five are more than the step."""
_NOT_YET, _SINCE = 0.25, 0.5
"""The same of the last step of a load that drifts, and of the drift since then at the same rate."""


class SmallSteps:
    """Small steps of the mass of one load.

    Attributes:
        unnoticed: Mass by which the load may have changed without being noticed yet [kg].
        disputed: Size of a step that was noticed, but that a faulty sensor may explain instead [kg].
    """

    def __init__(self) -> None:
        self.unnoticed = self.disputed = 0.0
        self._last_step, self._gap = 0.0, 0  # of a load that drifts, with the rows from one step to the next

    def begin_load(self) -> None:
        """Forget the steps of the last load; the next one may drift as it did."""
        self.unnoticed = self.disputed = 0.0

    def take(self, step: float, rows: int) -> None:
        """Note a step of the mass [kg], so many rows after the change before."""
        self._gap = rows if self._last_step * step > 0.0 else 0
        self._last_step, self.disputed, self.unnoticed = step, abs(step), 0.0

    def cover(self, estimate: Estimate, rows: int) -> Estimate:
        """Return an estimate whose covariance covers a small change of the mass that may have occurred.

        This is a step that is too small to be noticed yet, one that a faulty sensor may explain instead, or the drift
        of a load that keeps becoming lighter or heavier, which is assumed to continue for three more steps.

        Args:
            estimate: The estimate.
            rows: Number of rows since the last change.
        """
        load, theta = estimate.state.load, estimate.body.unknowns.theta
        step = _COVER * max(self.unnoticed, self.disputed)
        if rows < 3 * self._gap:
            step = max(step, (_NOT_YET + _SINCE * rows / self._gap) * abs(self._last_step))
        if load is None or step == 0.0:
            return estimate
        seen = estimate.seen.copy()
        seen[theta, theta] += step**2 * spread_mass(load[THETA], estimate.size)
        return replace(estimate, seen=seen)


def explaining_step(newest: Evidence, now: Estimate, covariance: Array, guards: Guards) -> tuple[float, Array] | None:
    """Return a small step of the mass that explains the newest rows, and the process noise of theta that it needs.

    What was known is half forgotten, because a load that drifts fits no constant one exactly.

    Args:
        newest: Evidence of the newest rows, around a fit to all others.
        now: That fit, with a load.
        covariance: Covariance of all unknowns in that fit, shape (u, u).
        guards: Thresholds.

    Returns:
        The step [kg] and a covariance (10, 10); None if the step is not small, or does not explain the rows.
    """
    load, theta = now.state.load, now.body.unknowns.theta
    assert load is not None
    step = mass_step(newest, load, theta)
    noise: Array = np.square(2.0 * step) * spread_mass(load[THETA], now.size) + covariance[theta, theta]
    covariance = covariance.copy()
    covariance[theta, theta] += noise
    is_small = abs(step) < guards.small * load[THETA.start]
    if not is_small or surprise(newest, covariance, theta) > guards.explained:
        return None
    return step, noise
