"""Drawing of changes only, so that nothing is sent to the browser twice."""

from __future__ import annotations

from collections.abc import Callable


class Changes:
    """Remembers the values that were drawn last."""

    def __init__(self) -> None:
        self._drawn: dict[str, object] = {}

    def once(self, what: str, value: object, act: Callable[[], None]) -> None:
        """Call ``act`` if the value differs from the last one of this name."""
        if self._drawn.get(what, self) != value:
            self._drawn[what] = value
            act()
