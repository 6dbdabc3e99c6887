"""Fits that take the load to be the same in all rows: where it has most likely changed, and what a change makes wrong.

    x^ - x = -H^-1 sum_i a_i H_i dtheta,    H_i = information of the wrenches of row i,    H = that of the whole fit

if theta of row i differs from the present one by ``-a_i dtheta``: ``a_i`` is 1 for the rows before a step, and the age
of the row if theta drifts. Poses and sensor errors are wrong, too: they have to explain rows of several loads.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.change import change_within_fit, error_by_step, windows
from coheft.estimation.moments.chapter import Chapter
from coheft.estimation.moments.derivatives import MotionDerivatives
from coheft.estimation.moments.evidence import Evidence
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.likelihood import wrench_evidence
from coheft.estimation.moments.moments import Moments, wrench_moments
from coheft.estimation.moments.projected import ProjectedMoments


class OneLoad(NamedTuple):
    """A fit with one load, and the rows around it.

    Attributes:
        estimate: The fit; it has a load.
        chapter: Rows and prior.
        fitted: Index of the first row that was not fitted.
        end: Index after the last row in question.
    """

    estimate: Estimate
    chapter: Chapter
    fitted: int
    end: int

    def wrenches(self, index: int, end: int) -> Evidence:
        """Evidence of the wrenches of the rows from one index to another, around the estimate."""
        return self._evidence(ProjectedMoments.of(self.chapter.buffer.rows[index:end], self.estimate.body))

    def likeliest_change(self) -> int:
        """Index of the first row after the likeliest change of the load; allows for all uncertainty."""
        start, theta = self.chapter.buffer.start, self.estimate.body.unknowns.theta
        newest: Evidence | None = None
        statistics = dict[int, float]()
        for end, index in pairwise([self.end, *(self.end - windows(self.end - start)).tolist()]):
            stretch = self.wrenches(index, end)
            newest = stretch if newest is None else newest + stretch
            statistics[index] = change_within_fit(newest, self.estimate.inverse, theta)
        return max(statistics, key=lambda index: statistics[index], default=start)

    def error_by_step(self, index: int) -> Array:
        """Derivative of the error by a step of theta before the row at this index, shape (u, 10)."""
        return error_by_step(
            self.wrenches(index, self.fitted), self.estimate.inverse, self.estimate.body.unknowns.theta
        )

    def error_by_drift(self, missing: float = 0.0) -> Array:
        """Derivative of the error at the last row in question by a drift of theta per row, shape (u, 10).

        Args:
            missing: Number of rows that are missing since.
        """
        buffer, body, theta = self.chapter.buffer, self.estimate.body, self.estimate.body.unknowns.theta
        rows, older = self.end - buffer.start + missing, buffer.load_rows - (buffer.count - buffer.start)
        ages = rows - 1.0 - np.arange(self.fitted - buffer.start)
        kept = np.sqrt(ages)[:, None] * buffer.rows[buffer.start : self.fitted]
        aged = self._evidence(ProjectedMoments.of(kept, body)).information
        if older:
            aged = aged + (rows + 0.5 * older) * self._evidence(buffer.moments_dropped()).information
        aged = aged + (rows + older) * self.chapter.prior_evidence(body).information
        result: Array = -self.estimate.inverse @ aged[:, theta]
        return result

    def _evidence(self, moments: Moments) -> Evidence:
        body, load = self.estimate.body, self.estimate.state.load
        assert load is not None
        return wrench_evidence(body, MotionDerivatives.at(body), wrench_moments(body, moments), load)
