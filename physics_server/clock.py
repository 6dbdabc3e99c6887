"""When the next block may be simulated: as soon as all have answered, or when the wall clock says so."""

from __future__ import annotations

import math
import time
from typing import Protocol

from coheft.wire.config import ClockKind

_MADE_UP_FOR = 0.1
"""Delays up to this are made up for by the next blocks [s], so that small ones do not add up."""


class Clock(Protocol):
    """Decides when blocks are simulated. References of block k answer the measurements of block k - lag."""

    def start(self, block: int) -> None:
        """Let time run, with this block next."""

    def delay(self, block: int, answered: int) -> float:
        """Time until a block may be simulated [s]; infinite if that depends on answers.

        Args:
            block: The block.
            answered: The last block that every robot has answered.
        """


_WIDE = 4
"""With so many blocks under way some may wait for others without a robot having nothing to do."""


class Lockstep:
    """Waits for every robot: as fast as the slowest, and always the same result.

    Where many blocks may be under way they are simulated by twos: whoever wakes up for one block has two to do.
    """

    def __init__(self, lag: int) -> None:
        self._lag = lag
        self._burst = 2 if lag >= _WIDE else 1

    def start(self, block: int) -> None:
        """Nothing to do: no time runs."""

    def delay(self, block: int, answered: int) -> float:
        """Zero once all references of the block, and of the other one of the two, are here."""
        last = block - block % self._burst + self._burst - 1
        return 0.0 if answered >= last - self._lag else math.inf


class Realtime:
    """Waits for none: a block is simulated when the wall clock reaches its end."""

    def __init__(self, block_duration: float) -> None:
        self._block_duration = block_duration
        self._origin = time.monotonic()

    def start(self, block: int) -> None:
        """Let the block begin now."""
        self._origin = time.monotonic() - block * self._block_duration

    def delay(self, block: int, answered: int) -> float:
        """Time until the block's end; zero if that is past."""
        return max(0.0, -self.behind(block))

    def behind(self, block: int) -> float:
        """How long ago the block ended on the wall clock [s]; negative if it has not."""
        return time.monotonic() - self._origin - (block + 1) * self._block_duration


class Paced:
    """Waits for every robot, and for the wall clock: in real time where all can keep pace, slower elsewhere."""

    def __init__(self, lag: int, block_duration: float) -> None:
        self._robots = Lockstep(lag)
        self._wall = Realtime(block_duration)

    def start(self, block: int) -> None:
        """Let the block begin now."""
        self._wall.start(block)

    def delay(self, block: int, answered: int) -> float:
        """Time until the block's end once all references are here; time that was lost is not made up for."""
        if self._robots.delay(block, answered) > 0.0:
            return math.inf
        if self._wall.behind(block) > _MADE_UP_FOR:
            self._wall.start(block + 1)  # let this one end now
        return self._wall.delay(block, answered)


def make_clock(kind: ClockKind, lag: int, block_duration: float) -> Clock:
    """The clock of that kind."""
    match kind:
        case "lockstep":
            return Lockstep(lag)
        case "paced":
            return Paced(lag, block_duration)
        case "realtime":
            return Realtime(block_duration)


class Stopwatch:
    """Adds up the wall time during which the simulation ran."""

    def __init__(self) -> None:
        self._before = 0.0
        self._since: float | None = None

    def start(self) -> None:
        """Let it run."""
        if self._since is None:
            self._since = time.monotonic()

    def stop(self) -> None:
        """Hold it."""
        self._before, self._since = self.elapsed, None

    @property
    def elapsed(self) -> float:
        """Time for which it ran [s]."""
        return self._before + (time.monotonic() - self._since if self._since is not None else 0.0)
