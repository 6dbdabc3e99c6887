"""The states that a robot reported, as spans of time."""

from __future__ import annotations

from dataclasses import dataclass, replace

from coheft.app.results.states import State
from coheft.wire.messages.structs import Estimate

_MOST = 400
"""Longest list of spans; then the shortest of them becomes part of the one before."""


@dataclass(frozen=True, slots=True)
class Span:
    """A time [s] in which a robot reported the same about its knowledge."""

    start: float
    end: float
    state: State
    not_observable: tuple[str, ...]
    reasons: tuple[str, ...]


class Spans:
    """The spans of one robot up to its newest estimate."""

    def __init__(self) -> None:
        self.spans: list[Span] = []

    def add(self, estimate: Estimate) -> None:
        """Add the next estimate, which is for the time since the one before."""
        start = self.spans[-1].end if self.spans else 0.0
        new = Span(start, estimate.time, State.of(estimate), tuple(estimate.not_observable), tuple(estimate.reasons))
        if self.spans and new == replace(self.spans[-1], start=new.start, end=new.end):
            self.spans[-1] = replace(self.spans[-1], end=new.end)
            return
        self.spans.append(new)
        if len(self.spans) > _MOST:
            shortest = min(range(1, _MOST), key=lambda k: self.spans[k].end - self.spans[k].start)
            self.spans[shortest - 1] = replace(self.spans[shortest - 1], end=self.spans[shortest].end)
            del self.spans[shortest]
