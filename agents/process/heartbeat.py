"""A function that is called at regular intervals, however long a step takes."""

from collections.abc import Callable
from threading import Event, Thread

PERIOD = 0.5
"""Usual time between two calls [s]."""


class Heartbeat:
    """Calls a function every ``period`` seconds in a separate thread, inside a ``with`` statement.

    An exception in ``beat`` ends the calls; it is printed, but not raised in the other thread.
    """

    def __init__(self, beat: Callable[[], None], period: float = PERIOD) -> None:
        self._beat, self._period = beat, period
        self._stopped = Event()
        self._thread = Thread(target=self._run, daemon=True)

    def _run(self) -> None:
        while not self._stopped.wait(self._period):
            self._beat()

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        self._thread.join()
