"""Robots whose link was lost while the run goes on, and how long their return is waited for."""

from __future__ import annotations

import time


class Absences:
    """Who is away.

    Args:
        limit: How long a return is waited for [s].
    """

    def __init__(self, limit: float) -> None:
        self._limit = limit
        self._waited_for: dict[str, float] = {}
        self._given_up: set[str] = set()

    def begin(self, name: str) -> None:
        """A robot has gone; it may come and go until it is back."""
        if name not in self._given_up:
            self._waited_for.setdefault(name, time.monotonic() + self._limit)

    def end(self, name: str) -> None:
        """It is back."""
        self._waited_for.pop(name, None)
        self._given_up.discard(name)

    @property
    def waited_for(self) -> list[str]:
        """Robots that may still come back in time."""
        return list(self._waited_for)

    @property
    def given_up(self) -> set[str]:
        """Robots that did not."""
        return self._given_up

    def give_up(self) -> list[str]:
        """Give up those that have been away for too long, and name them."""
        now = time.monotonic()
        names = [name for name, deadline in self._waited_for.items() if deadline <= now]
        for name in names:
            del self._waited_for[name]
            self._given_up.add(name)
        return names
