"""Sums of samples since ``O(log n)`` borders between blocks, dense among the newest, ever sparser towards the oldest.

For every border there is the sum of all that came after it, so that any two stretches can be compared: an exponential
histogram, after Bifet and Gavalda (2007).
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
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
        count: Number of blocks that were pushed, those that were forgotten among them, but not those that came early.
    """

    def __init__(self, size: int, resolution: int) -> None:
        self._resolution = resolution
        self.count = 0
        # Border k is the beginning of block _firsts[k], the _orders[k]-th that came.
        self._firsts: list[int] = []
        self._orders: list[int] = []
        # What came since the older borders is in rows _places[k] of _sums, but for the _late blocks: of these there is
        # the sum of what came before each of them. So a block costs little, and ``sums`` are brought up to date in one.
        self._sums = np.zeros((0, size))
        self._places: list[int] = []
        self._before_late: list[Array] = []
        self._late = np.zeros(size)

    def __len__(self) -> int:
        """Number of stretches, and of borders."""
        return len(self._firsts)

    @property
    def first(self) -> int:
        """First block of the oldest stretch, -1 if there is none."""
        return self._firsts[0] if self._firsts else -1

    @property
    def firsts(self) -> npt.NDArray[np.int64]:
        """First blocks of the stretches, oldest first, shape (k,)."""
        return np.array(self._firsts, dtype=np.int64)

    @property
    def sums(self) -> Array:
        """Of all that came since each of them, shape (k, size)."""
        self._bring_up_to_date()
        return self._sums

    def _bring_up_to_date(self) -> None:
        if self._before_late or len(self._places) < len(self._sums):
            older, newer = len(self._places), len(self._before_late)
            sums = np.empty((older + newer, len(self._late)))
            # Not checking each place needs no copy beside.
            self._sums.take(self._places, axis=0, out=sums[:older], mode="clip")
            sums[:older] += self._late
            if newer:
                np.subtract(self._late, self._before_late, out=sums[older:])
            self._set_sums(sums)

    def _set_sums(self, sums: Array) -> None:
        self._sums, self._places = sums, list(range(len(sums)))
        self._before_late, self._late = [], np.zeros_like(self._late)

    @property
    def total(self) -> Array:
        """Sum over all blocks that count, shape (size,)."""
        return self._late + (self._sums[self._places[0]] if self._places else 0.0)

    def joined(self, neighbours: int) -> Array:
        """Sums of so many stretches in a row: entry k is from border k to border ``k + neighbours``."""
        return self.sums[:-neighbours] - self.sums[neighbours:]

    def revise(self, update: Callable[[Array], Array]) -> None:
        """Change what was summed, because the samples are now seen differently.

        Args:
            update: From the sums of all stretches that end now, shape (k, size), to their new values.
        """
        if self._firsts:
            self._set_sums(update(self.sums))

    def push(self, block: int, sums: Array) -> None:
        """Take in a block: its number, larger than all before, and what is summed of it."""
        self._make_room()
        self._before_late.append(self._late)
        self._late = self._late + sums
        self._firsts.append(block)
        self._orders.append(self.count)
        self.count += 1

    def push_early(self, block: int, sums: Array) -> bool:
        """Take in a block from before all others, if there are any; returns whether there are."""
        if not self._firsts:
            return False
        self._make_room()
        self._set_sums(np.concatenate([self.sums[:1] + sums, self.sums]))
        self._firsts.insert(0, block)
        self._orders.insert(0, self._orders[0] - 1)
        return True

    def border(self, block: int) -> int:
        """The oldest border that does not lie before a block, as an index of ``firsts``; one past the end if none."""
        return bisect_left(self._firsts, block)

    def forget_before(self, block: int) -> None:
        """Forget all blocks with smaller numbers, and those that cannot be told apart from them any more."""
        self._drop(0, self.border(block))

    def forget_since(self, block: int) -> None:
        """Forget all blocks from this one on, and those that cannot be told apart from them any more."""
        kept = max(0, bisect_right(self._firsts, block) - 1)
        if kept < len(self):
            self._set_sums(self.sums - self.sums[kept])
            self._drop(kept, len(self))

    def forget_borders_before(self, block: int) -> None:
        """Keep all blocks, but no border before this one, except the oldest."""
        self._drop(1, max(1, self.border(block)))

    def _drop(self, first: int, end: int) -> None:
        """Drop the borders from ``first`` on, before ``end``."""
        if end > len(self._places):
            self._bring_up_to_date()
        del self._firsts[first:end], self._orders[first:end], self._places[first:end]

    def _make_room(self) -> None:
        """For another border: drop the newest one whose neighbours are close to each other for their age."""
        orders = self._orders
        for border in range(len(orders) - 2, 0, -1):
            if (orders[border + 1] - orders[border - 1]) * self._resolution <= self.count - orders[border + 1]:
                self._drop(border, border + 1)
                break
