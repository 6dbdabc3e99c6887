"""A link that can be cut, frozen, delayed and throttled: a relay of TCP connections between two endpoints."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections import deque
from dataclasses import dataclass, field
from typing import Self

from coheft.app.run_folder import split_endpoint

_CHUNK = 4096
_TICK = 0.001


@dataclass
class _Pipe:
    """One direction of one connection: bytes with the time at which they may leave."""

    source: socket.socket
    target: socket.socket
    waiting: deque[tuple[float, bytes]] = field(default_factory=deque)


class Relay:
    """Accepts at an endpoint of its own whoever dials, and dials the target in turn.

    Attributes:
        delay: Of everything, both ways [s].
        rate: Most bytes a second in one direction of one connection.
        is_frozen: Nothing passes, though connections stand; what was sent is kept.
    """

    def __init__(self, endpoint: str, target: str) -> None:
        self.delay = 0.0
        self.rate = float("inf")
        self.is_frozen = False
        self._target = split_endpoint(target)
        self._is_cut = False
        self._is_over = False
        self._lock = threading.Lock()
        self._sockets: set[socket.socket] = set()
        self._listener = socket.create_server(split_endpoint(endpoint))
        self._threads = [threading.Thread(target=self._accept)]
        self._threads[0].start()

    def cut(self) -> None:
        """End all connections, and refuse new ones."""
        with self._lock:
            self._is_cut = True
            self._close_connections()

    def heal(self) -> None:
        """Accept connections again."""
        self._is_cut = False

    def _close_connections(self) -> None:
        for connection in self._sockets:
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)  # wakes whoever reads it; close() alone would not
            connection.close()
        self._sockets.clear()

    def _accept(self) -> None:
        while not self._is_over:
            try:
                near = self._listener.accept()[0]
            except OSError:
                return
            with self._lock:
                if self._is_cut or self._is_over:
                    near.close()
                    continue
                try:
                    far = socket.create_connection(self._target)
                except OSError:
                    near.close()
                    continue
                self._sockets |= {near, far}
            for pipe in (_Pipe(near, far), _Pipe(far, near)):
                for work in (self._read, self._write):
                    self._threads.append(threading.Thread(target=work, args=(pipe,)))
                    self._threads[-1].start()

    def _read(self, pipe: _Pipe) -> None:
        """Take in what comes; an empty item marks the end."""
        data = b"-"
        while data:
            while self.is_frozen and not self._is_over:
                time.sleep(_TICK)
            try:
                data = pipe.source.recv(_CHUNK)
            except OSError:
                data = b""
            pipe.waiting.append((time.monotonic() + self.delay, data))

    def _write(self, pipe: _Pipe) -> None:
        """Hand on what may leave, until the end."""
        free_at = 0.0
        while not self._is_over:
            if self.is_frozen or not pipe.waiting or max(free_at, pipe.waiting[0][0]) > time.monotonic():
                time.sleep(_TICK)
                continue
            data = pipe.waiting.popleft()[1]
            free_at = time.monotonic() + len(data) / self.rate
            try:
                if not data:
                    pipe.target.shutdown(socket.SHUT_RDWR)
                    return
                pipe.target.sendall(data)
            except OSError:
                return

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._is_over = True
        with self._lock:
            with contextlib.suppress(OSError):
                self._listener.shutdown(socket.SHUT_RDWR)
            self._listener.close()
            self._close_connections()
        for thread in self._threads:
            thread.join()
