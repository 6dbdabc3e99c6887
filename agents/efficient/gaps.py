"""Small changes of the mass while rows were missing: nothing shows them but the rows since.

    error <= z sigma sqrt(I_n / I_k),    I_k = k times the information of one row

``sigma`` is the standard deviation of the mass, ``I_n`` the information on it of the rows before the gap, and ``I_k``
that of the ``k`` rows since. A step of the mass in the gap that is ``z`` times its standard deviation
``(1 / I_n + 1 / I_k)^(1/2)`` is just not significant, and makes a fit to all rows wrong by the share
``I_n / (I_n + I_k)`` of it.
"""

from __future__ import annotations

import math

from coheft.agents.efficient.knowledge import Knowledge
from coheft.agents.efficient.settings import Guards
from coheft.agents.efficient.small_steps import NO_STEP, UnnoticedStep
from coheft.estimation.chi_square import chi_square_threshold

_GROWTH = 1.1
"""The step is computed anew when there are so many times the rows: what is published need not follow each row."""


class Gap:
    """The newest gap in the rows of a team.

    Args:
        waiting: So few missing rows are no gap.
        guards: Thresholds.
    """

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
