"""Changes of the load that may not have been noticed: small steps of its mass, also while rows were missing, and drift.

    covariance + s^2 D E[x x^T] D^T + that of the error by the drift,    x = 1 kg anywhere in the load

with the standard deviation ``s`` of a step [kg]. ``D`` is the derivative of the error by a step of theta, see
``change_at_fit.error_by_step``: poses and sensor errors that were fitted together with one load to rows of two loads
are wrong, too. For the drift, see ``load_drift``. Nothing shows steps while rows were missing but the rows since:

    error <= z sigma sqrt(I_n / I_k),    I_k = k times the information of one row

``sigma`` is the standard deviation of the mass, ``I_n`` the information on it of the rows before the gap, and ``I_k``
that of the ``k`` rows since. A step of the mass in the gap that is ``z`` times its standard deviation
``(1 / I_n + 1 / I_k)^(1/2)`` is just not significant, and makes a fit to all rows wrong by the share
``I_n / (I_n + I_k)`` of it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from coheft.agents.efficient.knowledge import Knowledge
from coheft.agents.efficient.load_drift import LoadDrift
from coheft.agents.efficient.one_load import OneLoad
from coheft.agents.efficient.settings import Guards
from coheft.estimation.chi_square import chi_square_threshold
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.change import SmallStep, one_kilogram, spread_mass
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.unknowns import THETA

_COVER = 0.5
"""Standard deviation that is added, as a share of the possible step; five of them exceed the step."""
_LEAST_LEFT = 0.2
"""The mass is taken to be wrong by at least this share of a step."""
_GROWTH = 1.1
"""The step is computed anew when there are so many times the rows: what is published need not follow each row."""


class UnnoticedStep(NamedTuple):
    """A step of the mass that may have occurred without having been noticed yet.

    Attributes:
        mass: By how much the estimate of the mass may be off [kg].
        first: Number of the first row after the step.
    """

    mass: float = 0.0
    first: int = 0

    def after_test(self, found: SmallStep, first: int, share: float) -> UnnoticedStep:
        """Return the step to cover after one more test for small steps, which has found one before the row ``first``.
        The share ``share`` of the present step is left if that is larger.
        """
        faded = share * self.mass
        return UnnoticedStep(found.error, first) if found.error > faded else self._replace(mass=faded)

    def process_noise(self, estimate: Estimate, error_by_step: Array) -> Array:
        """Covariance (u, u) of the error that the step makes; ``error_by_step`` is ``D``, shape (u, 10)."""
        by_step = error_by_step.copy()
        if not _wrong_share(estimate, error_by_step) > _LEAST_LEFT:  # a fit to later rows only: it may have been later
            by_step[estimate.body.unknowns.theta] = -_LEAST_LEFT * np.eye(by_step.shape[1])
        return by_step @ self.covariance(estimate, error_by_step) @ by_step.T

    def covariance(self, estimate: Estimate, error_by_step: Array) -> Array:
        """Covariance (10, 10) of the step of theta itself; arguments as for ``process_noise``."""
        deviation = _COVER * self.mass / max(_LEAST_LEFT, _wrong_share(estimate, error_by_step))
        return deviation**2 * spread_mass(estimate)

    def before_change(self, known: Knowledge, estimate: Estimate, index: int) -> tuple[int, Array] | None:
        """Index of the first row after the step and its covariance, where the load changes at an index after an
        estimate; None if there is no step.
        """
        if not self.mass > 0.0:
            return None
        first = min(index, known.buffer.index_of(self.first))
        return first, self.covariance(estimate, known.one_load(estimate, index).error_by_step(first))


NO_STEP = UnnoticedStep()


def _wrong_share(estimate: Estimate, error_by_step: Array) -> float:
    """By which share of a step at the centre of mass the estimate of the mass is wrong."""
    error = error_by_step[estimate.body.unknowns.theta.start] @ one_kilogram(estimate.state.fitted_load)
    return -float(error)


class Unnoticed(NamedTuple):
    """Changes of the load that the covariance of an estimate has to cover.

    Attributes:
        step: The step of the mass that may have occurred.
        drift: The drift of the load, None if it does not drift.
    """

    step: UnnoticedStep = NO_STEP
    drift: LoadDrift | None = None

    def process_noise(
        self, known: Knowledge, estimate: Estimate, end: int | None = None, missing: float = 0.0
    ) -> Array | None:
        """Covariance (u, u) of the error of a prior by these changes, None if there are none. The estimate that is to
        be the prior is from the rows before the index ``end``, or from all; ``missing`` rows are missing since.
        """
        fit = known.one_load(estimate, end, is_last=end is None)
        step = self._of_step(known, estimate, fit)
        if self.drift is None:
            return step
        drifted = self.drift.process_noise(estimate, fit.error_by_drift(missing))
        return drifted if step is None else step + drifted

    def cover(self, known: Knowledge, estimate: Estimate, end: int | None = None) -> Estimate:
        """Return an estimate whose covariance covers these changes up to the row before an index, or up to now."""
        if estimate.state.load is None or (self.drift is None and self.step.mass == 0.0):
            return estimate
        fit = known.one_load(estimate, end)
        step = self._of_step(known, estimate, fit)
        if step is not None:
            estimate = estimate.with_process_noise(step)
        return estimate if self.drift is None else self.drift.cover(estimate, fit.error_by_drift())

    def _of_step(self, known: Knowledge, estimate: Estimate, fit: OneLoad) -> Array | None:
        """See ``UnnoticedStep.process_noise``; None if there is no step."""
        if self.step.mass == 0.0 or not estimate.state.fitted_load[THETA.start] > 0.0:
            return None
        return self.step.process_noise(estimate, fit.error_by_step(known.buffer.index_of(self.step.first)))


class Gap:
    """The newest gap in the rows of a team; so few missing rows as ``waiting`` are none."""

    def __init__(self, waiting: int, guards: Guards) -> None:
        self._waiting, self._guards = waiting, guards
        self._first: int | None = None  # number of the first row after the gap
        self._before = 0.0  # information of the rows before [1/kg²]

    def begin(self, known: Knowledge, first: int) -> None:
        """Note that the rows before this one are missing."""
        self._first, self._before = None, 0.0
        if known.estimate is not None and known.theta is not None:
            self._first, self._before = first, 1.0 / known.estimate.variance_of_mass

    def load_begins(self, number: int) -> None:
        """Forget the gap if it is not after this row, at which the present load begins."""
        if self._first is not None and number >= self._first:
            self._first = None

    def step(self, known: Knowledge) -> UnnoticedStep:
        """The largest step of the mass in the gap that is not significant; one of 0 kg if there was no gap."""
        estimate, buffer = known.estimate, known.buffer
        if self._first is None or estimate is None or known.theta is None:
            return NO_STEP
        index = buffer.index_of(self._first)
        if buffer.start < index < buffer.count:
            missing = buffer.numbers[index] - buffer.numbers[index - 1] - 1
            if missing <= self._waiting:  # they were only late
                self._first = None
                return NO_STEP
        rows = max(1, buffer.number_at(buffer.count) - self._first)
        since = _GROWTH ** math.floor(math.log(rows, _GROWTH)) * known.innovations.mass_information()
        if not since > 0.0:
            return NO_STEP
        ratio = estimate.variance_of_mass * self._before / since
        return UnnoticedStep(math.sqrt(chi_square_threshold(1, self._guards.small_step) * ratio), self._first)
