"""A heartbeat at regular intervals, however long a step takes."""

from __future__ import annotations

from collections.abc import Callable
from threading import Event, Thread

PERIOD = 0.5
"""Time between two beats [s]."""


class Heartbeat:
    """Calls a function every ``PERIOD`` seconds, from a thread of its own, while its context lasts."""

    def __init__(self, beat: Callable[[], None]) -> None:
        self._beat = beat
        self._over = Event()
        self._thread = Thread(target=self._run, daemon=True)

    def _run(self) -> None:
        while not self._over.wait(PERIOD):
            self._beat()

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
