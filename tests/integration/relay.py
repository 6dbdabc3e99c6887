"""A link that can be cut, frozen and throttled: a relay of TCP connections between two endpoints."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from queue import SimpleQueue
from typing import Self

from coheft.app.run.folder import split_endpoint

_CHUNK = 4096


class Relay:
    """Accepts at an endpoint of its own whoever dials, and dials the target in turn.

    Attributes:
        rate: Most bytes a second in one direction of one connection.
    """

    def __init__(self, endpoint: str, target: str) -> None:
        self.rate = float("inf")
        self._target = split_endpoint(target)
        self._flows = threading.Event()
        self._flows.set()
        self._is_cut = False
        self._lock = threading.Lock()
        self._sockets: set[socket.socket] = set()
        self._listener = socket.create_server(split_endpoint(endpoint))
        self._threads: list[threading.Thread] = []
        self._start(self._accept)

    def cut(self) -> None:
        """End all connections, and refuse new ones."""
        with self._lock:
            self._is_cut = True
            for connection in self._sockets:
                with contextlib.suppress(OSError):
                    connection.shutdown(socket.SHUT_RDWR)
            self._sockets.clear()

    def heal(self) -> None:
        """Accept connections again."""
        self._is_cut = False

    def freeze(self) -> None:
        """Let nothing pass, though connections stand; what is sent is kept."""
        self._flows.clear()

    def thaw(self) -> None:
        """Let pass what was kept, and what comes."""
        self._flows.set()

    def _start(self, work: object, *arguments: object) -> None:
        thread = threading.Thread(target=work, args=arguments)  # type: ignore[arg-type]
        self._threads.append(thread)
        thread.start()

    def _accept(self) -> None:
        while True:
            try:
                near = self._listener.accept()[0]
            except OSError:
                return
            with self._lock:
                far = None if self._is_cut else self._dial()
                if far is None:
                    near.close()
                    continue
                self._sockets |= {near, far}
            # Before any thread runs that may come to the connection's end, and close it.
            for end in (near, far):
                end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            for source, target in ((near, far), (far, near)):
                waiting: SimpleQueue[bytes] = SimpleQueue()
                self._start(self._read, source, waiting)
                self._start(self._write, target, waiting)

    def _dial(self) -> socket.socket | None:
        try:
            return socket.create_connection(self._target)
        except OSError:
            return None

    def _read(self, source: socket.socket, waiting: SimpleQueue[bytes]) -> None:
        """Take in what comes; nothing marks the end."""
        data = b"-"
        while data:
            try:
                data = source.recv(_CHUNK)
            except OSError:
                data = b""
            self._flows.wait()
            waiting.put(data)
            time.sleep(len(data) / self.rate)  # who sends faster has to wait in turn

    def _write(self, target: socket.socket, waiting: SimpleQueue[bytes]) -> None:
        """Hand it on, until the end."""
        with contextlib.suppress(OSError):
            while True:
                data = waiting.get()
                self._flows.wait()
                if not data:
                    break
                target.sendall(data)
        with contextlib.suppress(OSError):
            target.shutdown(socket.SHUT_RDWR)  # whoever reads from it comes to an end, too
        target.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.thaw()
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self.cut()
        for thread in self._threads:
            thread.join()
