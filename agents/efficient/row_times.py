"""Division of one robot's blocks of samples into rows: several per block, or one for several blocks.

row n holds the samples from n L up to (n + 1) L,    L = samples of a row; shifted back by the margin that rates need
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import SAMPLE_SIZE
from coheft.estimation.moments.rows import (
    LONGEST,
    flexing,
    flexing_margin,
    row_of_samples,
    row_with_rates,
    rows_per_block,
)
from coheft.estimation.moments.sensor_errors import SensorErrors

LARGE_TEAM, _MOST_TIMES = 32, 5
"""In teams of more robots than this, rows are longer in proportion, but at most so many times."""


@dataclass(frozen=True)
class RowTimes:
    """Which rows lie in which blocks, of ``block`` samples each; a row has ``row`` of them, ``L``."""

    block: int
    row: int

    @staticmethod
    def of_team(count: int, block: int, rate: float) -> RowTimes:
        """Choose the length of rows for ``count`` robots with ``block`` samples per block and ``rate`` per second."""
        longest = LONGEST * min(_MOST_TIMES, math.ceil(count / LARGE_TEAM))
        parts = rows_per_block(block, rate, longest)
        spanned = max(1, math.floor(longest * rate / block + 1e-9)) if parts == 1 else 1
        return RowTimes(block, block * spanned // parts)

    @property
    def spanned(self) -> int:
        """Number of blocks that a row spans."""
        return -(-self.row // self.block)

    def begun_from(self, block: int) -> int:
        """Number of the first row that starts with this block or later."""
        return -(-block * self.block // self.row)

    def complete(self, block: int) -> int:
        """Number of rows that are complete at the end of this block."""
        return (block + 1) * self.block // self.row

    def first_block(self, number: int) -> int:
        """Block in which a row begins."""
        return number * self.row // self.block

    def last_block(self, number: int) -> int:
        """Block in which a row ends."""
        return ((number + 1) * self.row - 1) // self.block


class OwnRows:
    """Cuts one robot's samples into rows.

    Args:
        times: Times of rows.
        gyro_variance: Variance of one gyro sample [rad²/s²].
        rate: Samples per second.
        errors: Declared errors of sensors: they say what follows each row.
    """

    def __init__(self, times: RowTimes, gyro_variance: float, rate: float, errors: SensorErrors) -> None:
        self._times, self._gyro_variance, self._rate, self._errors = times, gyro_variance, rate, errors
        self._margin = flexing_margin(rate) if errors.is_flexing else int(errors.has_rates)
        self._kept, self._end = np.zeros((0, SAMPLE_SIZE)), 0

    def add(self, index: int, samples: Array) -> list[tuple[int, Array]]:
        """Add a block of samples (B, 15); return numbers and rows that it completes, none with missing samples."""
        size, block, lead = self._times.row, self._times.block, 2 * self._margin
        has_gap = self._end != index * block
        kept = samples if has_gap or not len(self._kept) else np.concatenate([self._kept, samples])
        self._end = (index + 1) * block
        start, end = self._end - len(kept), self._end // size
        self._kept = kept[max(0, end * size - lead - start) :]
        first = -(-(start + lead) // size)
        begins = [(number, number * size - lead - start) for number in range(first, end)]
        return [(number, self._row(kept[begin : begin + lead + size])) for number, begin in begins]

    def _row(self, samples: Array) -> Array:
        """Of its samples and those before and after it, shape (L + 2 margin, 15)."""
        own = slice(self._margin, len(samples) - self._margin)
        if self._errors.has_rates:
            row = row_with_rates(samples[own.start - 1 : own.stop + 1], self._gyro_variance, self._rate)
        else:
            row = row_of_samples(samples[own], self._gyro_variance, self._rate)
        return np.concatenate([row, flexing(samples, self._margin, self._rate)]) if self._errors.is_flexing else row
