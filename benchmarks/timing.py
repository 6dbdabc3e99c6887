"""Ratios of times that were measured side by side: what slows the machine down slows down both."""

from __future__ import annotations

import statistics
from collections.abc import Sequence


def ratio(times: Sequence[float], others: Sequence[float]) -> float:
    """Median over the rounds of how many times as long one took as the other."""
    return statistics.median(mine / its for mine, its in zip(times, others, strict=True))
