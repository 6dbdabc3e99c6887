"""The supervisor's heartbeat to the server: a line on the server's stdin, several times a second.

A supervisor that is stopped (Ctrl-Z, SIGSTOP) would miss the rest of its run, and its report would be missing or wrong.
So the server pauses the run while no heartbeat arrives, and then resumes it.
"""

from __future__ import annotations

import select
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import IO

from coheft.wire.process.supervised import BEAT


@contextmanager
def beating(stdin: IO[bytes] | None) -> Iterator[None]:
    """Send heartbeats while the context lasts; ``stdin`` is the server's."""
    is_over = threading.Event()
    assert stdin is not None

    def beat() -> None:
        while not is_over.wait(BEAT):
            with suppress(OSError, ValueError):  # the server has ended, or its stdin is closed
                if select.select([], [stdin], [], 0.0)[1]:  # do not wait for a frozen server, which reads nothing
                    stdin.write(b"\n")
                    stdin.flush()

    thread = threading.Thread(target=beat, daemon=True)
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        thread.join()
