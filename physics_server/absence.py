"""Robots whose link is lost during a run, and how long to wait for their return."""

from __future__ import annotations

import time


class Absences:
    """Keeps track of robots whose link is lost."""

    def __init__(self, limit: float) -> None:
        self._limit = limit
        self._waited_for: dict[str, float] = {}
        self._given_up: set[str] = set()

    def begin(self, name: str) -> None:
        """Note that a robot's link is lost; the deadline for its return counts from the first loss."""
        if name not in self._given_up:
            self._waited_for.setdefault(name, time.monotonic() + self._limit)

    def end(self, name: str) -> None:
        """Note that a robot is back."""
        self._waited_for.pop(name, None)
        self._given_up.discard(name)

    @property
    def waited_for(self) -> list[str]:
        """Robots that are away and may still return in time."""
        return list(self._waited_for)

    @property
    def given_up(self) -> set[str]:
        """Robots that did not return in time."""
        return self._given_up

    def give_up(self) -> list[str]:
        """Give up robots that have been away for too long; return their names."""
        now = time.monotonic()
        names = [name for name, deadline in self._waited_for.items() if deadline <= now]
        for name in names:
            del self._waited_for[name]
            self._given_up.add(name)
        return names
