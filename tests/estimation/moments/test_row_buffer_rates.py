"""The buffer where rows are extended by how fast they change, which is not known before the next one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coheft.estimation.moments.moments import RowMoments
from coheft.estimation.moments.row_buffer import RowBuffer
from tests.estimation.moments.moving_team import PERIOD
from tests.estimation.moments.numbered_rows import SIZE, assert_moments, central, extended, moving, row

pytestmark = pytest.mark.usefixtures("few_rows_are_kept")


@pytest.mark.parametrize("count", range(5))
def test_the_first_and_the_newest_row_have_no_rates_yet(count: int) -> None:
    expected = central(*range(1, count - 1))
    buffer = moving(range(count))
    assert_moments(buffer, expected, expected)
    np.testing.assert_allclose(buffer.moments_kept().matrix, expected, atol=1e-9 * max(1.0, expected.max()))


def test_a_new_row_has_the_rate_from_the_row_before_it() -> None:
    buffer = moving(range(4))
    np.testing.assert_allclose(buffer.extended(4, row(4)), extended(4, 3, 4), rtol=1e-12)
    assert not buffer.extended(6, row(6))[SIZE:].any()
    np.testing.assert_allclose(buffer.extended(7, row(7)), extended(7, 6, 7), rtol=1e-12)


@pytest.mark.parametrize("place", [4, 5, 8, 9, 10])
@pytest.mark.parametrize("is_looked_at", [False, True])
def test_no_rate_spans_a_change_even_if_it_was_a_row_earlier(place: int, is_looked_at: bool) -> None:
    buffer = moving(range(10))
    last = buffer.begin_load(place)
    assert isinstance(last, RowMoments)
    np.testing.assert_allclose(last.matrix, central(*range(1, place - 2)), atol=1e-5)
    for number in range(10, 12):
        if is_looked_at:
            load = central(*range(place + 1, number - 1))
            assert_moments(buffer, load + central(*range(1, place - 2)), load)
        buffer.add(number, buffer.extended(number, row(number)))
    load = central(*range(place + 1, 11))
    assert_moments(buffer, load + central(*range(1, place - 2)), load)
    assert buffer.load_rows == 12 - place
    # Rates of rows that are kept are from one side next to the change.
    np.testing.assert_allclose(buffer.rows[place - 1], extended(place - 1, place - 2, place - 1), rtol=1e-9)
    if place < 9:
        np.testing.assert_allclose(buffer.rows[place], extended(place, place, place + 1), rtol=1e-9)


def test_rates_within_a_window_are_its_own() -> None:
    buffer = moving(range(8))
    window = buffer.window(4)
    expected = [extended(4, 4, 5), extended(5), extended(6), extended(7, 6, 7)]
    np.testing.assert_allclose(window, expected, rtol=1e-9)
    assert not buffer.window(7)[0, SIZE:].any()
    np.testing.assert_allclose(buffer.rows[4], extended(4), rtol=1e-9)
    still = RowBuffer(SIZE, False, PERIOD)
    still.add(0, row(0))
    np.testing.assert_array_equal(still.window(0), [row(0)])


@pytest.mark.parametrize("kept", [2, 3, 5])
def test_a_page_that_keeps_two_rows_loses_no_rate(kept: int) -> None:
    buffer = moving(range(10))
    everything, load = buffer.begin_chapter(10 - kept, is_cut=False)
    assert isinstance(everything, RowMoments)
    assert isinstance(load, RowMoments)
    np.testing.assert_allclose(everything.matrix, central(*range(1, 10 - kept)), atol=1e-5)
    np.testing.assert_allclose(load.matrix, everything.matrix)
    for number in range(10, 13):
        buffer.add(number, buffer.extended(number, row(number)))
    expected = central(*range(10 - kept, 12))
    assert_moments(buffer, expected, expected)


@pytest.mark.parametrize("place", [4, 8, 9, 10])
def test_no_rate_spans_a_cut_between_chapters(place: int) -> None:
    buffer = moving(range(10))
    everything, _ = buffer.begin_chapter(place, is_cut=True)
    assert isinstance(everything, RowMoments)
    np.testing.assert_allclose(everything.matrix, central(*range(1, place - 2)), atol=1e-5)
    for number in range(10, 14):
        buffer.add(number, buffer.extended(number, row(number)))
    expected = central(*range(place + 1, 13))
    assert_moments(buffer, expected, expected)


@given(st.lists(st.tuples(st.sampled_from(["rows", "load", "chapter", "page"]), st.integers(0, 9)), max_size=12))
def test_rows_with_rates_whatever_happens(operations: list[tuple[str, int]]) -> None:
    buffer, newest, begin, start = moving(range(5)), 4, 1, 0
    former: set[int] = set()
    for what, size in operations:
        first = int(buffer.numbers[0])
        if what == "rows":
            for number in range(newest + 1, newest + 2 + size):
                buffer.add(number, buffer.extended(number, row(number)))
            newest += 1 + size
        elif what == "page" and newest - size >= max(start + 3, first):
            place = newest - max(1, size)
            buffer.begin_chapter(place - first, is_cut=False)
            former, begin, start = set(), place, place
        elif what in ("load", "chapter") and newest - size >= max(start, first) + 4:
            cut = newest - size
            if what == "load":
                buffer.begin_load(cut - first)
                former |= set(range(begin, cut - 2))
            else:
                buffer.begin_chapter(cut - first, is_cut=True)
                former = set()
            begin, start = cut + 1, cut
        load = central(*range(begin, newest))
        assert_moments(buffer, load + central(*sorted(former)), load)
