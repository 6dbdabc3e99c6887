"""What a process says of what goes wrong: to its log and to observers, and no more than somebody can read."""

from __future__ import annotations

import time

from coheft.errors import one_line
from coheft.wire.messages.structs import Problem
from coheft.wire.process.log import LOG
from coheft.wire.transport.sessions import Sender

BURST = 50
RATE = 5.0
"""Lines per second, after the first ``BURST``."""


class ProblemLog:
    """Tells observers and the log what is wrong.

    Somebody who sends rubbish without end must not fill the disk: what is too much is counted, and the count is told
    with the next line.
    """

    def __init__(self, source: str, sender: Sender) -> None:
        self.count = 0
        self._source = source
        self._sender = sender
        self._allowed = float(BURST)
        self._last = time.monotonic()
        self._untold = 0

    def tell(self, text: str) -> None:
        """Say it, or only count it."""
        self.count += 1
        now = time.monotonic()
        self._allowed = min(BURST, self._allowed + RATE * (now - self._last))
        self._last = now
        if self._allowed < 1.0:
            self._untold += 1
            return
        self._allowed -= 1.0
        if self._untold:
            text += f" (and {self._untold} more problems before)"
            self._untold = 0
        text = one_line(text)  # it may quote what a stranger has sent
        LOG.warning("%s", text)
        self._sender.send(Problem(source=self._source, text=text))

    def tell_end(self, text: str) -> None:
        """Say to observers why the run ends: the log has it otherwise."""
        self._sender.send(Problem(source=self._source, text=text, is_end=True))
