"""The supervisor's sign of life to the server: a line on its stdin, several times a second.

A supervisor that is stopped (Ctrl-Z, SIGSTOP) would miss the rest of its run, and have no report, or one that is wrong.
The server lets time stand still as soon as the lines no longer come, and goes on with them.
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
    """Beat while the context lasts; ``stdin`` is the server's."""
    is_over = threading.Event()
    assert stdin is not None

    def beat() -> None:
        while not is_over.wait(BEAT):
            with suppress(OSError, ValueError):  # the server has gone, or is being told to go
                if select.select([], [stdin], [], 0.0)[1]:  # one that is frozen reads nothing: do not wait for it
                    stdin.write(b"\n")
                    stdin.flush()

    thread = threading.Thread(target=beat, daemon=True)
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        thread.join()
