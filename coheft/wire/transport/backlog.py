"""The queue of unread messages of one source: bounded in memory, and read in turn with those of all other sources."""

from __future__ import annotations

import ctypes
import sys
from collections import deque
from queue import SimpleQueue
from threading import Lock, local
from typing import NamedTuple

import zenoh

ROOM = 8 * 2**20
"""Limit of the unread messages of one source [B]: enough for minutes without reading, and a bound of the memory however
much is sent."""
_OVERHEAD = 512
_BUFFER = 2**16
"""Smallest size of a query: one of Zenoh's receive buffers [B]."""
_state = local()


class RawMessage(NamedTuple):
    """A message as received."""

    key: zenoh.KeyExpr
    data: bytes


class Backlog:
    """The unread messages of one source; when it is full, the oldest is dropped.

    ``put`` is called by Zenoh's own threads. A backlog that is not empty has one place in the queue of all backlogs, so
    that no source waits for more than one message of each other source; each place is used for one ``take``. No item is
    larger than ``ROOM``, so items are dropped only if a newer one is kept; the report of dropped items takes a place of
    its own.
    """

    def __init__(self, source: str, turns: SimpleQueue[Backlog]) -> None:
        self.source = source
        self._turns = turns
        self._items: deque[tuple[object, int]] = deque()
        self._size = 0
        self._lock = Lock()
        self._lost = 0

    def put(self, item: object) -> None:
        """Add a sample, a query, or an event."""
        keep_thread_state()
        if isinstance(item, zenoh.Sample):
            # A copy, because the sample would keep a whole receive buffer alive.
            item = RawMessage(item.key_expr, item.payload.to_bytes())
            size = _OVERHEAD + len(item.data)
        else:
            size = _BUFFER
        with self._lock:
            if not self._items:
                self._turns.put(self)
            self._items.append((item, size))
            self._size += size
            while self._size > ROOM:
                self._size -= self._items.popleft()[1]
                self._lost += 1

    def take(self) -> object:
        """Return the oldest item, or first the number of items that were dropped because the queue was full."""
        with self._lock:
            if self._lost:
                lost, self._lost = self._lost, 0
                self._turns.put(self)
                return lost
            item, size = self._items.popleft()
            self._size -= size
            if self._items:
                self._turns.put(self)
            return item


def keep_thread_state() -> None:
    """Keep the Python state of the calling thread until it ends, if Zenoh has started it; to be called in a callback.

    Python creates a state for a thread that it does not know, and deletes it when the callback returns. With each
    message this takes memory from the system and gives it back, which causes page faults. One additional reference to
    the state, which is never released, keeps it (``PyGILState_Ensure`` in the Python/C API). Other implementations of
    Python do not need this.
    """
    if not hasattr(_state, "is_kept"):
        _state.is_kept = True
        if sys.implementation.name == "cpython":
            ctypes.pythonapi.PyGILState_Ensure()
