"""What sensors have measured, from Zenoh's threads to the one that reads it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from queue import Empty, SimpleQueue
from typing import NamedTuple

from coheft.app.ros2.samples import read
from coheft.errors import MessageError
from coheft.estimation.geometry.spatial import Array

AT_ONCE = 1024
"""So much is read before agents are heard: somebody may measure faster than can be read."""
_ROOM = 2**16
"""Measurements that may wait; where more come than can be read, the newest are lost."""


class Reading(NamedTuple):
    """What a robot's sensors have measured, and when [ns]; when it came [ns], by a clock of our own."""

    robot: str
    stream: str
    stamp: int
    values: Array
    arrival: int


class Readings:
    """Measurements that wait to be read.

    Args:
        complain: Called with what was refused, and why.

    Attributes:
        came: Streams, by robot and kind, of which anything came, also what was refused.
    """

    def __init__(self, complain: Callable[[str], None]) -> None:
        self.came: set[tuple[str, str]] = set()
        self._complain = complain
        self._waiting: SimpleQueue[tuple[str, str, bytes, int]] = SimpleQueue()

    def put(self, robot: str, stream: str, cdr: bytes) -> None:
        """Let a message wait, in any thread."""
        self.came.add((robot, stream))
        if self._waiting.qsize() < _ROOM:
            self._waiting.put((robot, stream, cdr, time.monotonic_ns()))

    def forget(self) -> None:
        """Forget all that waits."""
        while not self._waiting.empty():
            self._waiting.get()

    def take(self, seconds: float) -> Iterator[Reading]:
        """What waits and makes sense, so much of it as is read at once; if there is nothing, wait that long for it."""
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
