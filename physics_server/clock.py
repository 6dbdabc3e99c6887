"""Clocks that decide when the next block is simulated: when all robots have answered, or at a wall-clock time."""

import math
import time

from coheft.wire.config import ClockKind

_COMPENSATED = 0.1
"""Delays up to this are compensated by the next blocks [s], so that small ones do not accumulate."""
_PAIRS_FROM = 4
"""From this lag on, blocks come in pairs: each process wakes up half as often, and no robot is without work."""


class Clock:
    """Decides when blocks are simulated. References of block k answer the measurements of block k - lag.

    ``lockstep`` waits for every robot: as fast as the slowest one, with reproducible results. ``realtime`` waits for no
    robot: a block is simulated when the wall clock reaches its end. ``paced`` waits for both: real time if all robots
    can keep pace, slower otherwise.
    """

    def __init__(self, kind: ClockKind, lag: int, block_duration: float) -> None:
        self.waits_for_robots = kind != "realtime"
        self._follows_wall = kind != "lockstep"
        self._lag, self._block_duration = lag, block_duration
        self._burst = 2 if lag >= _PAIRS_FROM else 1
        self._origin = time.monotonic()

    def start(self, block: int) -> None:
        """Start the time, with this block now."""
        self._origin = time.monotonic() - block * self._block_duration

    def delay(self, block: int, answered: int) -> float:
        """Return the time until a block may be simulated [s]; infinite if that depends on answers.

        ``answered`` is the last block that every robot has answered.
        """
        last = block - block % self._burst + self._burst - 1  # references of a pair have to be here together
        if self.waits_for_robots and answered < last - self._lag:
            return math.inf
        if not self._follows_wall:
            return 0.0
        if self.waits_for_robots and self._until_end(block) < -_COMPENSATED:
            self.start(block + 1)  # makes this block end now: longer delays are not compensated
        return max(0.0, self._until_end(block))

    def _until_end(self, block: int) -> float:
        """Return the time until the block's end on the wall clock [s]; negative if that is past."""
        return self._origin + (block + 1) * self._block_duration - time.monotonic()


class Stopwatch:
    """Measures the wall time during which the simulation runs."""

    def __init__(self) -> None:
        self._before = 0.0
        self._since: float | None = None

    def start(self) -> None:
        """Start, or continue."""
        if self._since is None:
            self._since = time.monotonic()

    def stop(self) -> None:
        """Stop."""
        self._before, self._since = self.elapsed, None

    @property
    def elapsed(self) -> float:
        """Time for which it has run [s]."""
        return self._before + (time.monotonic() - self._since if self._since is not None else 0.0)
