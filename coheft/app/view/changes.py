"""What has not changed is not sent to the browser again."""

from __future__ import annotations

from collections.abc import Callable


class Changes:
    """Remembers what was drawn last."""

    def __init__(self) -> None:
        self._drawn: dict[str, object] = {}

    def once(self, what: str, value: object, act: Callable[[], None]) -> None:
        """Do it if its value is another one than last time."""
        if self._drawn.get(what, self) != value:
            self._drawn[what] = value
            act()
