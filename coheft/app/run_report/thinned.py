"""Series of any length in limited memory."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Generic, TypeVar

T = TypeVar("T")


class Thinned(Generic[T]):
    """At most ``capacity`` evenly spread items of a series: all, then every second, every fourth, …; and the last.

    Attributes:
        every: One of so many items is kept.
    """

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

    def __len__(self) -> int:
        return sum(1 for _ in self)
