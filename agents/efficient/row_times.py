"""Division of one robot's blocks of samples into rows: several per block, or one for several blocks.

row n holds the samples from n L up to (n + 1) L,    L = samples of a row; with rates it is a sample earlier
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import SAMPLE_SIZE
from coheft.estimation.moments.rows import LONGEST, row_of_samples, row_with_rates, rows_per_block

MANY, _MOST_TIMES = 32, 5
"""In teams of more robots than these rows are longer, in proportion to the team and at most so many times."""
_BEFORE = 2
"""Samples before a row that its rates need."""
Numbers = TypeVar("Numbers", int, npt.NDArray[np.int64])


@dataclass(frozen=True)
class RowTimes:
    """Which row lies in which block.

    Attributes:
        block: Samples of a block.
        row: Samples of a row, ``L``.
    """

    block: int
    row: int

    @staticmethod
    def of_team(count: int, block: int, rate: float) -> RowTimes:
        """For so many robots, whose sensors give so many samples per block and second."""
        longest = LONGEST * min(_MOST_TIMES, math.ceil(count / MANY))
        parts = rows_per_block(block, rate, longest)
        spanned = max(1, math.floor(longest * rate / block + 1e-9)) if parts == 1 else 1
        return RowTimes(block, block * spanned // parts)

    @property
    def spanned(self) -> int:
        """Blocks that a row is of."""
        return -(-self.row // self.block)

    def begun_from(self, block: int) -> int:
        """Number of the first row that starts with this block or later."""
        return -(-block * self.block // self.row)

    def complete(self, block: int) -> int:
        """So many rows are complete at the end of this block."""
        return (block + 1) * self.block // self.row

    def first_block(self, number: int) -> int:
        """Block in which a row begins."""
        return number * self.row // self.block

    def last_block(self, number: Numbers) -> Numbers:
        """Block in which it ends, or of several rows those in which they end."""
        return ((number + 1) * self.row - 1) // self.block


class OwnRows:
    """Cuts one robot's samples into rows.

    Args:
        times: Of rows.
        gyro_variance: Of one sample [rad²/s²].
        rate: Samples per second.
        with_rates: Whether rows are followed by their rates.
    """

    def __init__(self, times: RowTimes, gyro_variance: float, rate: float, with_rates: bool = False) -> None:
        self._times, self._gyro_variance, self._rate = times, gyro_variance, rate
        self._row, self._before = (row_with_rates, _BEFORE) if with_rates else (row_of_samples, 0)
        self._kept, self._end = np.zeros((0, SAMPLE_SIZE)), 0

    def add(self, index: int, samples: Array) -> list[tuple[int, Array]]:
        """Numbers and rows that a block of samples (B, 15) completes; of a row of which samples are missing nothing."""
        size, block = self._times.row, self._times.block
        has_gap = self._end != index * block
        kept = samples if has_gap or not len(self._kept) else np.concatenate([self._kept, samples])
        self._end = (index + 1) * block
        start, end, before = self._end - len(kept), self._end // size, self._before
        self._kept = kept[max(0, end * size - before - start) :]
        first = -(-(start + before) // size)
        begins = [(number, number * size - before - start) for number in range(first, end)]
        return [
            (number, self._row(kept[begin : begin + before + size], self._gyro_variance, self._rate))
            for number, begin in begins
        ]
