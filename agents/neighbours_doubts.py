"""Who is new to a load does not know what it was: neighbours that do tell whether it may have changed."""

from __future__ import annotations

from collections.abc import Iterable


class NeighboursDoubts:
    """What neighbours have told of their doubts since a team began; what comes later, each finds out by itself.

    Args:
        neighbours: Those who may know more; none if this robot knows as much.
    """

    def __init__(self, neighbours: Iterable[str]) -> None:
        self._listens_to = set(neighbours)
        self._in_doubt: set[str] = set()

    def hear(self, name: str, is_in_doubt: bool) -> None:
        """A neighbour tells whether it is in doubt; once it is not, it is not asked any more."""
        if not is_in_doubt:
            self._listens_to.discard(name)
        self._in_doubt = (self._in_doubt | {name}) & self._listens_to

    @property
    def by(self) -> str | None:
        """One that is in doubt."""
        return min(self._in_doubt, default=None)
