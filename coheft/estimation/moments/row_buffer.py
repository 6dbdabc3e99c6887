"""The rows of a whole team: the newest ones one by one, and the moments of all of them.

    moments of all = moments of former loads + moments of the present load
    rates of a row = (next row - previous row) / (2 period)

Rows may come in any order; each goes where it belongs. Where rates are needed, a row is in the moments only if the
rows before and after it came before it was summed, and nothing changed between them: its rates are not known otherwise.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.body import FORCING_SIZE, BodyModel
from coheft.estimation.moments.moments import Moments, RowMoments
from coheft.estimation.moments.projected import ProjectedMoments
from coheft.estimation.moments.rows import WRENCH_SIZE

KEPT = 1024
"""At least so many of the newest rows are kept; there is room for twice as many."""
VIEW_SIZE = FORCING_SIZE + WRENCH_SIZE
_LEAST_TO_PROJECT = 200
"""Rows from which on poses are known well enough to see moments from there."""
_BEFORE_CHANGE = 2
"""Rows before a change whose rates may span it, as it may have been a row earlier."""


class RowBuffer:
    """Rows of complete teams, in order.

    Args:
        size: Numbers of a team's row, the constant 1 included.
        is_moving: Whether rows are extended by their rates.
        period: Of rows [s].
        is_projected: Whether moments may be kept as seen from one state, once there is one to see them from.

    Attributes:
        rows: Extended rows, shape (2 KEPT, X); the first ``count`` of them are there.
        views: ``(motion[FORCING], wrench)`` of each at the newest state, shape (2 KEPT, 19).
        numbers: Number of each.
        has_rates: Whether each can be in the moments, which needs its rates if there are any.
        start: Place of the first one with the present load.
    """

    def __init__(self, size: int, is_moving: bool, period: float, is_projected: bool = False) -> None:
        self._size, self._moving, self._period, self._is_projected = size, int(is_moving), period, is_projected
        width = size + (size - 1) * self._moving
        self.rows, self.views = np.zeros((2 * KEPT, width)), np.zeros((2 * KEPT, VIEW_SIZE))
        self.numbers, self.has_rates = np.zeros(2 * KEPT, dtype=np.int64), np.zeros(2 * KEPT, dtype=bool)
        self.count = self.start = 0
        self._former: Any = None  # Moments of former loads
        self._load: Any = RowMoments(np.zeros((width, width)))
        self._summed = 0  # rows before this place are in the moments, if they have rates
        self._dropped = 0  # rows of the present load that are not kept any more
        self._since = -1  # number of the first row with the present load, or of the chapter
        self._changed_at = -2  # number of the first row with another load than the one before
        self._seen_from: BodyModel | None = None
        self._has_dropped = False

    @property
    def load_rows(self) -> int:
        """Number of rows with the present load."""
        return self._dropped + self.count - self.start

    @property
    def keeps_whole_load(self) -> bool:
        """Whether all of them are kept."""
        return self._dropped == 0

    def summed_views(self) -> Array:
        """Views of those of them that are both kept and in the moments, shape (n, 19)."""
        return self._that_can(self.views, self.start, self._summed)

    def extended(self, number: int, row: Array) -> Array:
        """A new row (size,) with its rates, as far as they are known from the row before it."""
        if not self._moving:
            return row
        rates, place = np.zeros(self._size - 1), self._place_of(number)
        if place > 0 and self.numbers[place - 1] == number - 1:
            rates = (row[:-1] - self.rows[place - 1, : self._size - 1]) / self._period
        return np.concatenate([row, rates])

    def add(self, number: int, row: Array) -> tuple[int, bool]:
        """Take in an extended row where it belongs.

        Returns:
            Its place, and whether the older half of all rows had to make room: places have changed then.
        """
        is_full = self.count == len(self.rows)
        if is_full:
            self._sum_up()
            self._drop(KEPT)
        place = self._place_of(number)
        if place < self.count:
            for buffer in self._buffers:
                buffer[place + 1 : self.count + 1] = buffer[place : self.count]
        self.rows[place], self.numbers[place], self.has_rates[place] = row, number, not self._moving
        self.count += 1
        is_of_former = number < self._since
        if not self._moving and (is_of_former or place < self._summed):
            if is_of_former:
                self._former = None if self._former is None else self._former + self.moments_of(row[None])
            else:
                self._load = self._load + self.moments_of(row[None])
        self.start += is_of_former
        self._summed += is_of_former or place < self._summed
        for near in range(max(place - 1, self._summed, 1), min(place + 2, self.count - 1)):
            self._set_rates(near)
        return place, is_full

    def _place_of(self, number: int) -> int:
        """Place behind all rows with no larger numbers."""
        place = self.count
        while place > 0 and self.numbers[place - 1] > number:
            place -= 1
        return place

    def _set_rates(self, place: int) -> None:
        """Of a row that has others on both sides, if these are the next ones and none is of another load."""
        rows, size, numbers = self.rows, self._size, self.numbers
        number = numbers[place]
        if not self._moving or numbers[place - 1] != number - 1 or numbers[place + 1] != number + 1:
            return
        if number == self._changed_at:  # no rate spans a change
            rows[place, size:] = (rows[place + 1, : size - 1] - rows[place, : size - 1]) / self._period
        elif number != self._changed_at - 1:
            rows[place, size:] = (rows[place + 1, : size - 1] - rows[place - 1, : size - 1]) / (2.0 * self._period)
            self.has_rates[place] = True

    def moments(self) -> tuple[Moments, Moments]:
        """Of all rows, and of those with the present load: the same object if there was no other load."""
        self._sum_up()
        everything = self._load if self._former is None else self._former + self._load
        return everything, self._load

    def moments_of(self, rows: Array) -> Moments:
        """Moments of extended rows (n, X), of the kind that can be added to the others."""
        return RowMoments.of(rows) if self._seen_from is None else ProjectedMoments.of(rows, self._seen_from)

    def moments_since(self, place: int) -> Moments:
        """Of the rows from this place on that are in the moments."""
        self._sum_up()
        return self._moments_between(place, self._summed)

    def moments_kept(self) -> RowMoments:
        """Of all rows that are kept."""
        return RowMoments.of(self._that_can(self.rows, 0, self.count))

    def _moments_between(self, first: int, end: int) -> Moments:
        return self.moments_of(self._that_can(self.rows, first, end))

    def _that_can(self, buffer: Array, first: int, end: int) -> Array:
        """What is in a buffer of rows that can be in the moments."""
        return buffer[first:end][self.has_rates[first:end]] if self._moving else buffer[first:end]

    def window(self, place: int) -> Array:
        """Rows from this place on, the first one's rates without the row before it, shape (n, X)."""
        rows, size = self.rows[place : self.count], self._size
        if self._moving:
            rows = rows.copy()
            rows[0, size:] = (rows[1, : size - 1] - rows[0, : size - 1]) / self._period if len(rows) > 1 else 0.0
        return rows

    def see_from(self, body: BodyModel) -> None:
        """From now on keep what is seen from this state, if the team is large."""
        self._sum_up()
        if not self._is_projected or (self._seen_from is None and self.count < _LEAST_TO_PROJECT):
            return
        self._seen_from = body
        if not self._has_dropped:  # all rows are kept, so they are seen anew
            self._load = self._moments_between(self.start, self._summed)
            if self._former is not None:
                self._former = self._moments_between(0, self.start)
            return
        self._load = self._load.seen_from(body)
        if self._former is not None:
            self._former = self._former.seen_from(body)

    def take_back(self, number: int) -> int:
        """Rows with larger numbers are taken out again, as if they had never come; returns how many were."""
        self._sum_up()
        first = int(np.searchsorted(self.numbers[: self.count], number, side="right"))
        first = max(first, self.start)
        taken = self.count - first
        last = max(self.start, first - self._moving)  # the rates of the row before them are in part theirs
        if taken and last < self._summed:
            self._load = self._load - self._moments_between(last, self._summed)
            self._summed = last
        if taken:
            self.has_rates[last:first] = False
        self.count = first
        return taken

    def begin_load(self, place: int) -> Moments:
        """From this place on the load is another one; no rate spans the change. Returns the moments of the last one."""
        self._sum_up()
        newer = self.moments_since(max(self.start, place - _BEFORE_CHANGE * self._moving))
        last: Moments = self._load - newer
        self._part_rates(place)
        self._former = last if self._former is None else self._former + last
        self._load = self.moments_since(place)
        self.start, self._dropped = place, 0
        self._since = self._changed_at = self._number_at(place)
        return last

    def begin_chapter(self, place: int) -> tuple[Moments, Moments]:
        """Forget all rows before this place.

        Returns:
            The moments of all that are forgotten, and of those of them with the present load.
        """
        everything, of_load = self.moments()
        newer = self.moments_since(place)
        self._former, self._load = None, newer
        self._since = self._number_at(place)
        self._drop(place)
        self.start, self._dropped = 0, 0
        return everything - newer, of_load - newer

    @property
    def _buffers(self) -> tuple[npt.NDArray[Any], ...]:
        return self.rows, self.views, self.numbers, self.has_rates

    def _number_at(self, place: int) -> int:
        """Number of the row at this place, or of the one that will come there."""
        return int(self.numbers[place] if place < self.count else self.numbers[place - 1] + 1)

    def _part_rates(self, place: int) -> None:
        """Rates of the rows next to a change, each from its own side of it; none of them can be in moments."""
        if not self._moving:
            return
        size, rows = self._size, self.rows
        self.has_rates[max(0, place - _BEFORE_CHANGE) : place + 1] = False
        if place > 1:
            rows[place - 1, size:] = (rows[place - 1, : size - 1] - rows[place - 2, : size - 1]) / self._period
        if place < self.count:
            following = rows[min(place + 1, self.count - 1), : size - 1]
            rows[place, size:] = (following - rows[place, : size - 1]) / self._period

    def _drop(self, dropped: int) -> None:
        """The oldest rows are not kept any more."""
        kept = self.count - dropped
        for buffer in self._buffers:
            buffer[:kept] = buffer[dropped : self.count].copy()
        self._dropped += max(0, dropped - self.start)
        self.start, self._summed = max(0, self.start - dropped), max(0, self._summed - dropped)
        self.count, self._has_dropped = kept, True

    def _sum_up(self) -> None:
        """All rows whose rates are known enter the moments."""
        end = self.count - self._moving
        if end > self._summed:
            self._load = self._load + self._moments_between(self._summed, end)
            self._summed = end
