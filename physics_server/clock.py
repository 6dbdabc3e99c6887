"""Clocks that decide when the next block is simulated: when all robots have answered, or at a wall-clock time."""

from __future__ import annotations

import math
import time
from typing import Protocol

from coheft.wire.config import ClockKind

_COMPENSATED = 0.1
"""Delays up to this are compensated by the next blocks [s], so that small ones do not accumulate."""


class Clock(Protocol):
    """Decides when blocks are simulated. References of block k answer the measurements of block k - lag."""

    def start(self, block: int) -> None:
        """Start the time, with this block next."""

    def delay(self, block: int, answered: int) -> float:
        """Return the time until a block may be simulated [s]; infinite if that depends on answers.

        Args:
            block: The block's index.
            answered: The last block that every robot has answered.
        """


_PAIRS_FROM = 4
"""From this lag on, blocks are simulated in pairs, which leaves no robot without work."""


class Lockstep:
    """Waits for every robot: as fast as the slowest robot, with reproducible results.

    With a large lag, blocks are simulated in pairs, so that each process wakes up half as often.
    """

    def __init__(self, lag: int) -> None:
        self._lag = lag
        self._burst = 2 if lag >= _PAIRS_FROM else 1

    def start(self, block: int) -> None:
        """Do nothing, as this clock has no time."""

    def delay(self, block: int, answered: int) -> float:
        """Return zero once all references of the block, and of the other one of its pair, are here."""
        last = block - block % self._burst + self._burst - 1
        return 0.0 if answered >= last - self._lag else math.inf


class Realtime:
    """Waits for no robot: a block is simulated when the wall clock reaches its end."""

    def __init__(self, block_duration: float) -> None:
        self._block_duration = block_duration
        self._origin = time.monotonic()

    def start(self, block: int) -> None:
        """Start the block now."""
        self._origin = time.monotonic() - block * self._block_duration

    def delay(self, block: int, answered: int) -> float:
        """Return the time until the block's end [s]; zero if that is past."""
        return max(0.0, -self.behind(block))

    def behind(self, block: int) -> float:
        """Return how long ago the block ended on the wall clock [s]; negative if it has not ended."""
        return time.monotonic() - self._origin - (block + 1) * self._block_duration


class Paced:
    """Waits for every robot and for the wall clock: real time if all can keep pace, slower otherwise."""

    def __init__(self, lag: int, block_duration: float) -> None:
        self._robots = Lockstep(lag)
        self._wall = Realtime(block_duration)

    def start(self, block: int) -> None:
        """Start the block now."""
        self._wall.start(block)

    def delay(self, block: int, answered: int) -> float:
        """Return the time until the block's end once all references are here; longer delays are not compensated."""
        if self._robots.delay(block, answered) > 0.0:
            return math.inf
        if self._wall.behind(block) > _COMPENSATED:
            self._wall.start(block + 1)  # makes this block end now
        return self._wall.delay(block, answered)


def make_clock(kind: ClockKind, lag: int, block_duration: float) -> Clock:
    """Return a clock of the given kind."""
    match kind:
        case "lockstep":
            return Lockstep(lag)
        case "paced":
            return Paced(lag, block_duration)
        case "realtime":
            return Realtime(block_duration)


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
