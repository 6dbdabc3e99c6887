"""What a source has said and no one has read yet: bounded in memory, and in turn with all other sources."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from queue import SimpleQueue
from threading import Lock
from typing import NamedTuple

import zenoh

from coheft.wire.transport.callback_thread import keep_thread_state

ROOM = 8 * 2**20
"""For what one source has said and no one has read yet [B]: minutes of a listener's absence, and no more of its memory
than that, however much is said."""
_OVERHEAD = 512
_BUFFER = 2**16
"""What a query takes at least: one of Zenoh's receive buffers [B]."""


class Said(NamedTuple):
    """A message as it came."""

    key: zenoh.KeyExpr
    data: bytes


@dataclass(frozen=True)
class Lost:
    """Word that so many items are lost, because there was no room."""

    count: int


class Backlog:
    """What one source has said and no one has read yet; when there is no room, the oldest goes.

    ``put`` is called by Zenoh's own threads. A backlog that is not empty has one turn in the queue of all of them, so
    that no source waits for more than one message of each other source; with every turn goes one ``take``. Items are
    lost only while a newer one stays, because none is larger than ``ROOM``; word of that takes a turn of its own.

    Args:
        source: Its name.
        turns: The queue.
    """

    def __init__(self, source: str, turns: SimpleQueue[Backlog]) -> None:
        self.source = source
        self._turns = turns
        self._items: deque[tuple[object, int]] = deque()
        self._size = 0
        self._lock = Lock()
        self._lost = 0

    def put(self, item: object) -> None:
        """Add a sample, a query, or an event as it is."""
        keep_thread_state()
        if isinstance(item, zenoh.Sample):
            # A copy, because the sample would keep a whole receive buffer alive.
            item = Said(item.key_expr, item.payload.to_bytes())
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

    @property
    def size(self) -> int:
        """What it takes [B]."""
        return self._size

    def take(self) -> object:
        """The oldest item; before it, word of those that were ``Lost``."""
        with self._lock:
            if self._lost:
                lost, self._lost = Lost(self._lost), 0
                self._turns.put(self)
                return lost
            item, size = self._items.popleft()
            self._size -= size
            if self._items:
                self._turns.put(self)
            return item
