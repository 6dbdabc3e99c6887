"""What a robot said it knew, and what it did not, from when to when."""

from __future__ import annotations

from dataclasses import dataclass, replace

from coheft.app.results.states import State
from coheft.wire.messages.structs import Estimate

_MOST = 400
"""Longest list of spans; then the shortest of them becomes part of the one before."""


@dataclass(frozen=True, slots=True)
class Span:
    """A time in which what a robot said of its knowledge stayed the same.

    Attributes:
        start: When it began [s].
        end: When it ended [s].
        state: How far the robot was.
        not_observable: What its motion had not shown.
        reasons: Why its estimate was not valid.
    """

    start: float
    end: float
    state: State
    not_observable: tuple[str, ...]
    reasons: tuple[str, ...]


class Spans:
    """The spans of one robot, as far as its estimates have come."""

    def __init__(self) -> None:
        self.spans: list[Span] = []

    def add(self, estimate: Estimate) -> None:
        """Take in the next estimate: it speaks for the time since the one before."""
        start = self.spans[-1].end if self.spans else 0.0
        said = Span(start, estimate.time, State.of(estimate), tuple(estimate.not_observable), tuple(estimate.reasons))
        if self.spans and said == replace(self.spans[-1], start=said.start, end=said.end):
            self.spans[-1] = replace(self.spans[-1], end=said.end)
            return
        self.spans.append(said)
        if len(self.spans) > _MOST:
            shortest = min(range(1, _MOST), key=lambda k: self.spans[k].end - self.spans[k].start)
            self.spans[shortest - 1] = replace(self.spans[shortest - 1], end=self.spans[shortest].end)
            del self.spans[shortest]
