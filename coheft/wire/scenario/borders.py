"""Times at which events take effect: at the start of a block, or at a sample."""

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Protocol, TypeVar

_ROUNDING = 1e-9  # of times [s]


class Event(Protocol):
    """Something that happens at a time."""

    @property
    def at(self) -> float:
        """The time [s]."""


E = TypeVar("E", bound=Event)


def first_border(time: float, duration: float) -> int:
    """Return the index of the first border at or after a time [s], where border ``k`` is at ``k * duration`` [s]."""
    return math.ceil((time - _ROUNDING) / duration)


def by_border(events: Iterable[E], duration: float) -> Mapping[int, list[E]]:
    """Group events, in the order of their times, by the border at which they take effect, see ``first_border``."""
    found: defaultdict[int, list[E]] = defaultdict(list)
    for event in sorted(events, key=lambda event: event.at):
        found[first_border(event.at, duration)].append(event)
    return found
