"""The supervisor's heartbeat to the server: a line on the server's stdin, several times a second.

A supervisor that is stopped (Ctrl-Z, SIGSTOP) would miss the rest of its run, and its report would be missing or wrong.
So the server pauses the run while no heartbeat arrives, and then resumes it.
"""

from __future__ import annotations

import select
from contextlib import suppress
from typing import IO

from coheft.agents.process.heartbeat import Heartbeat
from coheft.wire.process.supervised import BEAT


def beating(stdin: IO[bytes]) -> Heartbeat:
    """Return a context that sends heartbeats while it lasts; ``stdin`` is the server's."""

    def beat() -> None:
        with suppress(OSError, ValueError):  # the server has ended, or its stdin is closed
            if select.select([], [stdin], [], 0.0)[1]:  # do not wait for a frozen server, which reads nothing
                stdin.write(b"\n")
                stdin.flush()

    return Heartbeat(beat, BEAT)
