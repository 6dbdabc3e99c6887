"""Fits that take the load to be the same in all rows: where it has most likely changed, and what a change makes wrong.

    x^ - x = -H^-1 sum_i a_i H_i dtheta,    H_i = information of the wrenches of row i,    H = that of the whole fit

if theta of row i differs from the present one by ``-a_i dtheta``: ``a_i`` is 1 for the rows before a step, and the age
of the row if theta drifts. Poses and sensor errors are wrong, too: they have to explain rows of several loads.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.change import windows
from coheft.estimation.moments.change_at_fit import Shown, change_within_fit, error_by_step
from coheft.estimation.moments.chapter import Chapter, EvidenceAt
from coheft.estimation.moments.evidence import Evidence
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.likelihood import information_on_theta
from coheft.estimation.moments.moments import ProjectedMoments, wrench_moments


class OneLoad:
    """A fit with one load, and the rows around it. ``fitted`` is the index of the first row that was not fitted, and
    ``end`` that after the last row in question.
    """

    def __init__(self, estimate: Estimate, chapter: Chapter, fitted: int, end: int) -> None:
        self._estimate, self._chapter, self._fitted, self._end = estimate, chapter, fitted, end
        self._at_estimate = EvidenceAt(estimate.derivatives)
        self._drifted: tuple[int, Array] | None = None  # a row's number, and the error there by a drift, (u, 10)
        self._stepped: tuple[int, Array] | None = None  # the number of the first row after a step, and the error

    def at(self, fitted: int, end: int) -> OneLoad:
        """Move the indices, as rows have come, moved or gone since; return this fit."""
        self._fitted, self._end = fitted, end
        return self

    def wrenches(self, index: int, end: int) -> Evidence:
        """Evidence of the wrenches of the rows from one index to another, around the estimate."""
        body, rows = self._estimate.body, self._chapter.buffer.rows[index:end]
        return self._at_estimate.of_wrenches(wrench_moments(body, ProjectedMoments.of(rows, body)))

    def likeliest_change(self) -> int:
        """Index of the first row after the likeliest change of the load; allows for all uncertainty."""
        start, theta = self._chapter.buffer.start, self._estimate.body.unknowns.theta
        newest: Evidence | None = None
        statistics = dict[int, float]()
        for end, index in pairwise([self._end, *(self._end - windows(self._end - start)).tolist()]):
            stretch = self.wrenches(index, end)
            newest = stretch if newest is None else newest + stretch
            statistics[index] = float(change_within_fit(Shown.of(newest, theta), self._estimate.inverse))
        return max(statistics, key=lambda index: statistics[index], default=start)

    def error_by_step(self, index: int) -> Array:
        """Derivative of the error by a step of theta before the row at this index, shape (u, 10)."""
        number = self._chapter.buffer.number_at(index)
        if self._stepped is None or self._stepped[0] != number:
            newest = self._on_theta(self._chapter.buffer.rows[index : self._fitted])
            self._stepped = number, error_by_step(newest, self._estimate.inverse, self._estimate.body.unknowns.theta)
        return self._stepped[1]

    def error_by_drift(self, missing: float = 0.0) -> Array:
        """Derivative of the error at the last row in question by a drift of theta per row, shape (u, 10); so many rows
        are missing since.
        """
        number, theta = self._chapter.buffer.number_at(self._end), self._estimate.body.unknowns.theta
        if self._drifted is None:
            self._drifted = number, self._error_by_drift()
        last, error = self._drifted[0], self._drifted[1].copy()
        error[theta] -= (number - last + missing) * np.eye(error.shape[1])  # the fit stays, theta goes on
        return error

    def _error_by_drift(self) -> Array:
        buffer, body, theta = self._chapter.buffer, self._estimate.body, self._estimate.body.unknowns.theta
        rows, older = self._end - buffer.start, buffer.load_rows - (buffer.count - buffer.start)
        ages = rows - 1.0 - np.arange(self._fitted - buffer.start)
        aged = self._on_theta(np.sqrt(ages)[:, None] * buffer.rows[buffer.start : self._fitted])
        if older:
            dropped = wrench_moments(body, buffer.moments_dropped())
            aged += (rows + 0.5 * older) * information_on_theta(self._estimate.derivatives, dropped)
        aged += (rows + older) * self._chapter.prior_evidence(body).information[:, theta]
        return -self._estimate.inverse @ aged

    def _on_theta(self, rows: Array) -> Array:
        """Information between all unknowns and theta of the wrenches of rows (n, X), shape (u, 10)."""
        body = self._estimate.body
        moments = wrench_moments(body, ProjectedMoments.of(rows, body))
        return information_on_theta(self._estimate.derivatives, moments)
