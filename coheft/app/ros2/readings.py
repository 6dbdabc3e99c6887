"""Queue of sensor measurements, from Zenoh's threads to the thread that reads them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from queue import Empty, SimpleQueue
from typing import NamedTuple

from coheft.app.ros2.samples import read
from coheft.errors import MessageError
from coheft.estimation.geometry.spatial import Array

AT_ONCE = 1024
"""Number of measurements read before agents are served, because measurements may arrive faster than they are read."""
_ROOM = 2**16
"""Largest number of measurements in the queue; when it is full, the newest are lost."""


class Reading(NamedTuple):
    """A measurement with its stamp [ns] and its arrival [ns] by our own clock."""

    robot: str
    stream: str
    stamp: int
    values: Array
    arrival: int


class Readings:
    """Queue of measurements.

    Args:
        complain: Called with a description of refused messages.

    Attributes:
        came: Streams, by robot and kind, of which any message arrived, including refused ones.
    """

    def __init__(self, complain: Callable[[str], None]) -> None:
        self.came: set[tuple[str, str]] = set()
        self._complain = complain
        self._waiting: SimpleQueue[tuple[str, str, bytes, int]] = SimpleQueue()

    def put(self, robot: str, stream: str, cdr: bytes) -> None:
        """Add a message to the queue, in any thread."""
        self.came.add((robot, stream))
        if self._waiting.qsize() < _ROOM:
            self._waiting.put((robot, stream, cdr, time.monotonic_ns()))

    def forget(self) -> None:
        """Empty the queue."""
        while not self._waiting.empty():
            self._waiting.get()

    def take(self, seconds: float) -> Iterator[Reading]:
        """Return valid measurements from the queue, up to a limit; if it is empty, wait for a time."""
        for number in range(AT_ONCE):
            try:
                item = self._waiting.get_nowait() if number else self._waiting.get(timeout=seconds)
            except Empty:
                return
            robot, stream, cdr, arrival = item
            try:
                reading = Reading(robot, stream, *read(stream, cdr), arrival)
            except MessageError as error:
                self._complain(f"refused from /{robot}/{stream}: {error}")
                continue
            yield reading
