"""Ratios of times that were measured side by side, so that other load affects both."""

from __future__ import annotations

import statistics
from collections.abc import Sequence


def ratio(times: Sequence[float], others: Sequence[float]) -> float:
    """Return the median over the rounds of the ratio of two times."""
    return statistics.median(mine / its for mine, its in zip(times, others, strict=True))
