"""The physics server as it is on a machine that is too slow for it: behind real time from the first block to the last.

The server itself is the real one. Only its clock is ahead.
"""

from __future__ import annotations

from coheft.physics_server import server
from coheft.physics_server.clock import Clock

AHEAD = 3600.0
"""More than can be made up for in a test [s]."""


class FastClock(Clock):
    """All blocks are due."""

    def start(self, block: int) -> None:
        super().start(block)
        self._origin -= AHEAD


if __name__ == "__main__":
    server.Clock = FastClock
    server.main()
