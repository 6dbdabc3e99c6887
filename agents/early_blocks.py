"""Blocks from before all others, which count only when they have been tested together with the next new one."""

from __future__ import annotations

from coheft.estimation.load_samples import Memory
from coheft.estimation.spatial import Array


class EarlyBlocks:
    """Those that wait for the next new block. More may come, the newest first, until one is of another load.

    Attributes:
        first: The oldest one that has come, -1 while there is none.
    """

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """All may come, again."""
        self.first, self._are_over = -1, False
        self._waiting: list[tuple[int, Array]] = []

    def drop(self) -> None:
        """Those that wait are not wanted any more."""
        self._waiting.clear()

    def close(self) -> None:
        """No more may come."""
        self._are_over = True

    def end(self) -> None:
        """No more may come, and those that wait are not wanted any more."""
        self.drop()
        self.close()

    def add(self, block: int, moments: Array) -> None:
        """One has come, with its moments as ``Memory.push_early`` takes them."""
        if not self._are_over:
            self.first = block
            self._waiting.append((block, moments))

    def move_to(self, memory: Memory) -> None:
        """The next new block is there: those that wait can be tested."""
        for block, moments in self._waiting:
            memory.push_early(block, moments)
        self._waiting.clear()
