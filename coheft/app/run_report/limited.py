"""Series of any length in limited memory: evenly spread items, and the states that a robot reported as spans."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

from coheft.app.results.states import State
from coheft.wire.messages.structs import Estimate

_MOST = 400
"""Longest list of spans; then the shortest of them becomes part of the one before."""

T = TypeVar("T")


class Thinned(Generic[T]):
    """At most ``capacity`` evenly spread items of a series: all, then ``every`` second, fourth, …; and the last."""

    def __init__(self, capacity: int) -> None:
        self.every = 1
        self._capacity = capacity
        self._items: list[T] = []
        self._seen = 0
        self._last: T | None = None

    def add(self, item: T) -> None:
        """Add the next item."""
        self._last = item
        if self._seen % self.every == 0:
            if len(self._items) == self._capacity:
                del self._items[1::2]
                self.every *= 2
            if self._seen % self.every == 0:
                self._items.append(item)
        self._seen += 1

    def __iter__(self) -> Iterator[T]:
        yield from self._items
        if self._items and self._last is not None and self._last is not self._items[-1]:
            yield self._last


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
