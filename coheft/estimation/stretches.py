"""Sums of samples since ``O(log n)`` borders between blocks, dense among the newest, ever sparser towards the oldest.

For every border there is the sum of all that came after it, so that any two stretches can be compared: an exponential
histogram, after Bifet and Gavalda (2007).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from coheft.estimation.spatial import Array


class Stretches:
    """Blocks that count, and borders between them.

    Args:
        size: Numbers that are summed per block.
        resolution: Borders remain at most about ``1 / resolution`` of their age apart.

    Attributes:
        count: Number of blocks that have come, those that were forgotten among them.
    """

    def __init__(self, size: int, resolution: int) -> None:
        self._resolution = resolution
        self.count = 0
        # Border k is the beginning of block _firsts[k], the _orders[k]-th that came; _sums[k] is all that came since.
        self._firsts = np.zeros(64, dtype=np.int64)
        self._orders = np.zeros(64, dtype=np.int64)
        self._sums = np.zeros((64, size))
        self._borders = 0

    def __len__(self) -> int:
        """Number of stretches, and of borders."""
        return self._borders

    @property
    def firsts(self) -> npt.NDArray[np.int64]:
        """First blocks of the stretches, oldest first, shape (k,)."""
        return self._firsts[: self._borders]

    @property
    def sums(self) -> Array:
        """Of all that came since each of them, shape (k, size)."""
        return self._sums[: self._borders]

    @property
    def total(self) -> Array:
        """Sum over all blocks that count, shape (size,)."""
        return self._sums[0].copy() if self._borders else np.zeros(self._sums.shape[1])

    def joined(self, neighbours: int) -> Array:
        """Sums of so many stretches in a row: entry k is from border k to border ``k + neighbours``."""
        return self.sums[:-neighbours] - self.sums[neighbours:]

    def revise(self, update: Callable[[Array], Array]) -> None:
        """Change what was summed, because the samples are now seen differently.

        Args:
            update: From the sums of all stretches that end now, shape (k, size), to their new values.
        """
        if self._borders:
            self._sums[: self._borders] = update(self.sums)

    def push(self, block: int, sums: Array) -> None:
        """Take in a block: its number, larger than all before, and what is summed of it."""
        self._make_room()
        end = self._borders
        self._firsts[end], self._orders[end] = block, self.count
        self._sums[end] = 0.0
        self._borders += 1
        self._sums[: self._borders] += sums
        self.count += 1

    def push_early(self, block: int, sums: Array) -> bool:
        """Take in a block from before all others, if there are any; returns whether there are."""
        if not self._borders:
            return False
        self._make_room()
        for array in (self._firsts, self._orders, self._sums):
            array[1 : 1 + self._borders] = array[: self._borders].copy()
        self._firsts[0], self._orders[0] = block, self._orders[1] - 1
        self._sums[0] += sums
        self._borders += 1
        return True

    def border(self, block: int) -> int:
        """The oldest border that does not lie before a block, as an index of ``firsts``; one past the end if none."""
        return int(np.searchsorted(self.firsts, block))

    def forget_before(self, block: int) -> None:
        """Forget all blocks with smaller numbers, and those that cannot be told apart from them any more."""
        self._drop(0, self.border(block))

    def forget_since(self, block: int) -> None:
        """Forget all blocks from this one on, and those that cannot be told apart from them any more."""
        kept = int(np.searchsorted(self.firsts, block, side="right")) - 1
        if kept <= 0:
            self._borders = 0
        else:
            self._sums[:kept] -= self._sums[kept]
            self._borders = kept

    def forget_borders_before(self, block: int) -> None:
        """Keep all blocks, but no border before this one, except the oldest."""
        self._drop(1, max(1, self.border(block)))

    def _drop(self, first: int, end: int) -> None:
        """Drop the borders from ``first`` on, before ``end``."""
        left = self._borders - (end - first)
        for array in (self._firsts, self._orders, self._sums):
            array[first:left] = array[end : self._borders].copy()
        self._borders = left

    def _make_room(self) -> None:
        """For another border: drop the newest one whose neighbours are close to each other for their age."""
        orders = self._orders[: self._borders]
        close = (orders[2:] - orders[:-2]) * self._resolution <= self.count - orders[2:]
        if close.any():
            drop = 1 + int(np.flatnonzero(close)[-1])
            self._drop(drop, drop + 1)
        if self._borders == len(self._firsts):
            self._firsts = np.concatenate([self._firsts, np.zeros_like(self._firsts)])
            self._orders = np.concatenate([self._orders, np.zeros_like(self._orders)])
            self._sums = np.concatenate([self._sums, np.zeros_like(self._sums)])
