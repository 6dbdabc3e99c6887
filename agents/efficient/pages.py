"""Pages: chapters of fixed length, where sensors drift or the load is forgotten slowly.

    covariance of the next prior = that of the posterior + drift of sensors in the time t of the page
                                   + (e^(t / memory) - 1) times that of theta

Time is counted in numbers of rows, so that those which were lost count as well.
"""

from __future__ import annotations

import math

from coheft.estimation.moments.chapter import Prior
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.fit_settings import FitSettings

_IN_MEMORY, KEPT_ON_PAGE = 8, 2
"""A fading memory forgets in so many steps per time constant; each step keeps so many of the newest rows."""
_LONGEST_FADING = 20.0
"""After so many time constants without rows nothing is left of a load."""
_LONGEST_OF_DRIFT, _MATTERS_WITH_DRIFT = 2.0, 10.0
"""Longest step of sensor drift, and time of rows by which the interval between fits is chosen then [s]."""


class Pages:
    """The pages of one robot's knowledge. A page ends after ``length`` rows, 0 if there are none; ``rows_before`` rows
    of earlier ones matter for the interval between fits.
    """

    def __init__(self, settings: FitSettings) -> None:
        self._settings, memory = settings, settings.memory
        lengths = [memory / _IN_MEMORY] if memory is not None else []
        lengths += [min(_LONGEST_OF_DRIFT, settings.steady)] if settings.drift.is_any else []
        self.length = max(4, round(min(lengths) / settings.period)) if lengths else 0
        self.rows_before = 0
        self._begun: int | None = None  # number of the row at which the present page has begun

    def begin(self, number: int) -> None:
        """The first page begins at the row of this number."""
        if self._begun is None:
            self._begun = number

    def turn(self, rows: int, end: int, missing: float) -> float:
        """End the page of so many rows, and return its time [s].

        ``end`` is the number of the first row of the next page; rows from before a gap may be kept, and belong to both.
        For a time ``missing`` [s] there are no rows after the page.
        """
        period, memory = self._settings.period, self._settings.memory
        begun = end if self._begun is None else self._begun
        end = max(end, begun)
        self._begun = end + round(missing / period)
        longest = _MATTERS_WITH_DRIFT if memory is None else memory
        self.rows_before = min(self.rows_before + rows, round(longest / period))
        return (end - begun) * period + missing

    def inflated(self, prior: Prior, estimate: Estimate, seconds: float) -> Prior:
        """Return the prior that is left of an estimate after a time [s]."""
        settings, theta = self._settings, estimate.body.unknowns.theta
        if settings.memory is not None:
            faded = math.expm1(min(seconds / settings.memory, _LONGEST_FADING))
            prior = prior.with_process_noise(theta, faded * estimate.covariance[theta, theta])
        return prior.with_process_noise(*settings.drifted(estimate.body, seconds)) if settings.drift.is_any else prior
