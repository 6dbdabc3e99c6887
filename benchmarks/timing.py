"""Ratios of times that were measured side by side: what slows the machine down slows down both."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence

LEAST = 0.004
"""A round calls a candidate for at least so long [s]."""


def interleaved(candidates: Mapping[str, Callable[[], object]], rounds: int = 15) -> dict[str, list[float]]:
    """CPU time per call of each candidate [s], a number for each round; in a round all run, one after another.

    It is this process's CPU time: what others take of the machine is left out.
    """
    calls = {name: _calls(candidate) for name, candidate in candidates.items()}
    times: dict[str, list[float]] = {name: [] for name in candidates}
    for _ in range(rounds):
        for name, candidate in candidates.items():
            times[name].append(_time(candidate, calls[name]))
    return times


def ratio(times: Sequence[float], others: Sequence[float]) -> float:
    """Median over the rounds of how many times as long one took as the other."""
    return statistics.median(mine / its for mine, its in zip(times, others, strict=True))


def _time(candidate: Callable[[], object], calls: int) -> float:
    began = time.process_time()
    for _ in range(calls):
        candidate()
    return (time.process_time() - began) / calls


def _calls(candidate: Callable[[], object]) -> int:
    """How many calls take ``LEAST`` seconds."""
    candidate()
    calls = 1
    while (taken := _time(candidate, calls) * calls) < LEAST:
        calls = max(2 * calls, int(calls * LEAST / taken) if taken > 0.0 else 0)
    return calls
