"""The rows of a whole team: the newest ones one by one, and the moments of all of them.

    moments of all = moments of former loads + moments of the present load

Rows may come in any order; each goes where it belongs. One that comes after its chapter has ended counts for nothing.
Rows have numbers, which count time and never change, and indices in the buffer, which change when the older half is
dropped or a late row is inserted.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.body import FORCING_SIZE, BodyModel
from coheft.estimation.moments.moments import Moments, ProjectedMoments, RowMoments
from coheft.estimation.moments.rows import WRENCH_SIZE

LEAST_KEPT = 1024
"""At least this many of the newest rows are kept; there is room for twice as many."""
VIEW_SIZE = FORCING_SIZE + WRENCH_SIZE
_LEAST_TO_PROJECT = 200
"""Number of rows from which on poses are known well enough to project moments."""


class RowBuffer:
    """Rows of complete teams, in order.

    Args:
        size: Length of a team's row, ``X``.
        is_projected: Whether to project moments at one state, once poses are known.

    Attributes:
        rows: Rows of the team, shape (2 LEAST_KEPT, X), of which the first ``count`` are in use.
        views: ``(motion[FORCING], wrench)`` of each row at the newest state, shape (2 LEAST_KEPT, 19).
        numbers: Number of each row, shape (2 LEAST_KEPT,).
        count: Number of rows that are kept.
        start: Index of the first row with the present load.
    """

    def __init__(self, size: int, is_projected: bool = False) -> None:
        self._is_projected = is_projected
        self.rows, self.views = np.zeros((2 * LEAST_KEPT, size)), np.zeros((2 * LEAST_KEPT, VIEW_SIZE))
        self.numbers = np.zeros(2 * LEAST_KEPT, dtype=np.int64)
        self.count = self.start = 0
        self._former: Any = None  # Moments of former loads in this chapter, None if there was none
        self._load: Any = RowMoments(np.zeros((size, size)))  # Moments of the present load
        self._summed = 0  # index of the first row that is not in these moments yet
        self._dropped = 0  # how many rows of the present load are not kept any more; they stay in the moments
        self._since = -1  # number of the first row with the present load, or of the chapter
        self._projected_at: BodyModel | None = None  # None while moments are exact
        self._has_dropped = False  # whether any row of the chapter has been dropped

    @property
    def load_rows(self) -> int:
        """Number of rows with the present load."""
        return self._dropped + self.count - self.start

    @property
    def keeps_whole_load(self) -> bool:
        """Whether all rows with the present load are kept."""
        return self._dropped == 0

    @property
    def of_load(self) -> slice:
        """Slice of the rows with the present load that are kept."""
        return slice(self.start, self.count)

    def add(self, number: int, row: Array) -> tuple[int, bool]:
        """Insert a row (X,) in the order of numbers. Return its index, and whether the older half of all rows was
        dropped, in which case all indices have changed.
        """
        is_full = self.count == len(self.rows)
        if is_full:
            self._sum_up()
            self._drop(LEAST_KEPT)
        index = int(np.searchsorted(self.numbers[: self.count], number, side="right"))
        if index < self.count:
            for buffer in (self.rows, self.views, self.numbers):
                buffer[index + 1 : self.count + 1] = buffer[index : self.count]
        self.rows[index], self.numbers[index] = row, number
        self.count += 1
        if number < self._since:  # it is of a former load, or of a former chapter, and then in no moments
            self.start += 1
            if self._former is not None:
                self._former = self._former + self.moments_of(row[None])
        elif index < self._summed:  # the rows after it are in the moments already
            self._load = self._load + self.moments_of(row[None])
        if number < self._since or index < self._summed:
            self._summed += 1
        return index, is_full

    def moments(self) -> tuple[Moments, Moments]:
        """Moments of all rows, and of those with the present load; the same object if there was no other load."""
        self._sum_up()
        everything = self._load if self._former is None else self._former + self._load
        return everything, self._load

    def moments_of(self, rows: Array) -> Moments:
        """Compute moments of rows (n, X), projected if the others are."""
        return RowMoments.of(rows) if self._projected_at is None else ProjectedMoments.of(rows, self._projected_at)

    def moments_since(self, index: int) -> Moments:
        """Moments of the rows from this index on."""
        self._sum_up()
        return self.moments_of(self.rows[index : self.count])

    def moments_dropped(self) -> Moments:
        """Moments of the rows with the present load that are not kept any more."""
        self._sum_up()
        dropped: Moments = self._load - self.moments_of(self.rows[self.of_load])
        return dropped

    def moments_kept(self) -> RowMoments:
        """Moments of all rows that are kept."""
        return RowMoments.of(self.rows[: self.count])

    def project_at(self, body: BodyModel) -> None:
        """Project moments at this state from now on, if the team is large."""
        self._sum_up()
        if not self._is_projected or (self._projected_at is None and self.count < _LEAST_TO_PROJECT):
            return
        self._projected_at = body
        if not self._has_dropped:  # all rows are kept, so they are projected anew
            self._load = self.moments_of(self.rows[self.of_load])
            if self._former is not None:
                self._former = self.moments_of(self.rows[: self.start])
            return
        self._load = ProjectedMoments.at(body, self._load)
        if self._former is not None:
            self._former = ProjectedMoments.at(body, self._former)

    def take_back(self, number: int) -> int:
        """Remove the rows of the present load from this number on, as if they had never arrived; return how many."""
        first = self.index_of(number)
        taken, newest = self.count - first, self.moments_since(first)
        self._load = self._load - newest
        self.count = self._summed = first
        return taken

    def begin_load(self, index: int) -> Moments:
        """Start another load at this index; return the moments of the last load."""
        present = self.moments_since(index)
        last: Moments = self._load - present
        self._former = last if self._former is None else self._former + last
        self._load = present
        self.start, self._dropped = index, 0
        self._since = self.number_at(index)
        return last

    def begin_chapter(self, index: int) -> tuple[Moments, Moments]:
        """Forget all rows before this index; return their moments, and those of them with the present load."""
        everything, of_load = self.moments()
        newer = self.moments_since(index)
        self._former, self._load = None, newer
        self._since = self.number_at(index)
        self._drop(index)
        self.start, self._dropped, self._has_dropped = 0, 0, False
        return everything - newer, of_load - newer

    def index_of(self, number: int) -> int:
        """Index of the first row of the load with at least this number."""
        return max(self.start, int(np.searchsorted(self.numbers[: self.count], number)))

    def number_at(self, index: int) -> int:
        """Number of the row at this index, or of the next row to come there."""
        if self.count == 0:
            return self._since
        return int(self.numbers[index] if index < self.count else self.numbers[index - 1] + 1)

    def _drop(self, dropped: int) -> None:
        """Drop the oldest rows."""
        kept = self.count - dropped
        for buffer in (self.rows, self.views, self.numbers):
            buffer[:kept] = buffer[dropped : self.count].copy()
        self._dropped += max(0, dropped - self.start)
        self.start, self._summed = max(0, self.start - dropped), max(0, self._summed - dropped)
        self.count, self._has_dropped = kept, True

    def _sum_up(self) -> None:
        """Add all rows to the moments that are not in them yet."""
        if self.count > self._summed:
            self._load = self._load + self.moments_of(self.rows[self._summed : self.count])
            self._summed = self.count
