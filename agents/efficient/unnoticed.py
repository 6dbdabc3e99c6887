"""What may have changed of the load without having been noticed: a step of its mass, and its drift.

covariance + that of the error by the step + that of the error by the drift, see ``small_steps`` and ``load_drift``
"""

from __future__ import annotations

from typing import NamedTuple

from coheft.agents.efficient.knowledge import Knowledge
from coheft.agents.efficient.load_drift import LoadDrift
from coheft.agents.efficient.one_load import OneLoad
from coheft.agents.efficient.small_steps import NO_STEP, UnnoticedStep
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.unknowns import THETA


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
        """Covariance (u, u) of the error of a prior by these changes, None if there are none.

        Args:
            known: Rows and fit.
            estimate: The estimate that is to be the prior.
            end: The estimate is from the rows before this index; None if from all of them.
            missing: Number of rows that are missing since.
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
