"""Rate-limited reports of a process's problems, to its log and to observers."""

import time

from coheft.errors import one_line
from coheft.wire.messages.structs import Problem
from coheft.wire.process.log import LOG
from coheft.wire.transport.sessions import Sender

BURST = 50
RATE = 5.0
"""Lines per second, after the first ``BURST``."""


class ProblemLog:
    """Reports problems to observers and to the log.

    A sender of invalid messages must not fill the disk: problems beyond the rate are counted, and the next line reports
    their number.
    """

    def __init__(self, source: str, sender: Sender) -> None:
        self.count = 0
        self._source = source
        self._sender = sender
        self._allowed = float(BURST)
        self._last = time.monotonic()
        self._suppressed = 0

    def tell(self, text: str) -> None:
        """Report a problem, or only count it."""
        self.count += 1
        now = time.monotonic()
        self._allowed = min(BURST, self._allowed + RATE * (now - self._last))
        self._last = now
        if self._allowed < 1.0:
            self._suppressed += 1
            return
        self._allowed -= 1.0
        if self._suppressed:
            text += f" (and {self._suppressed} more problems before)"
            self._suppressed = 0
        text = one_line(text)  # it may quote received text
        LOG.warning("%s", text)
        self._sender.send(Problem(source=self._source, text=text))

    def tell_end(self, text: str) -> None:
        """Report to observers why the run ends; the log contains it already."""
        self._sender.send(Problem(source=self._source, text=text, is_end=True))
