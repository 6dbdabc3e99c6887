"""The buffer where rows are extended by how fast they change, which is not known before the next one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coheft.estimation.moments.moments import RowMoments
from coheft.estimation.moments.row_buffer import RowBuffer
from tests.estimation.moments.moving_team import PERIOD
from tests.estimation.moments.numbered_rows import SIZE, WIDTH, assert_moments, central, extended, gram, moving, row

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
    buffer.add(6, buffer.extended(6, row(6)))
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
    everything, load = buffer.begin_chapter(10 - kept)
    assert isinstance(everything, RowMoments)
    assert isinstance(load, RowMoments)
    np.testing.assert_allclose(everything.matrix, central(*range(1, 10 - kept)), atol=1e-5)
    np.testing.assert_allclose(load.matrix, everything.matrix)
    for number in range(10, 13):
        buffer.add(number, buffer.extended(number, row(number)))
    expected = central(*range(10 - kept, 12))
    assert_moments(buffer, expected, expected)


@given(st.lists(st.tuples(st.sampled_from(["rows", "load", "page"]), st.integers(0, 9)), max_size=12))
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
            buffer.begin_chapter(place - first)
            former, begin, start = set(), place, place
        elif what == "load" and newest - size >= max(start, first) + 4:
            start = newest - size
            buffer.begin_load(start - first)
            former |= set(range(begin, start - 2))
            begin = start + 1
        load = central(*range(begin, newest))
        assert_moments(buffer, load + central(*sorted(former)), load)


OPERATIONS = ["next", "next", "next", "gap", "late", "load", "back"]


@given(st.lists(st.tuples(st.sampled_from(OPERATIONS), st.floats(0.0, 1.0)), min_size=5, max_size=40))
def test_rows_that_are_late_or_missing_or_taken_back(operations: list[tuple[str, float]]) -> None:
    buffer, newest, missing, changed = RowBuffer(SIZE, True, PERIOD), -1, list[int](), {-1}
    for what, share in operations[:12]:  # so many rows are kept
        before = buffer.count
        if what in ("next", "gap"):
            missing += range(newest + 1, newest + 2 * (what == "gap"))
            newest += 1 + (what == "gap")
            buffer.add(newest, buffer.extended(newest, row(newest)))
        elif what == "late" and missing:
            number = missing.pop(round(share * (len(missing) - 1)))
            buffer.add(number, buffer.extended(number, row(number)))
        elif what == "load" and before:
            place = buffer.start + round(share * (before - buffer.start))
            changed.add(int(buffer.numbers[place] if place < before else buffer.numbers[place - 1] + 1))
            buffer.begin_load(place)
        elif what == "back" and before:
            buffer.take_back(int(buffer.numbers[round(share * (before - 1))]))
            there = set(buffer.numbers[: buffer.count].tolist())
            missing = [number for number in range(newest + 1) if number not in there]
        buffer.moments()
        can = np.flatnonzero(buffer.has_rates[: buffer.count])
        expected = {int(place): extended(int(buffer.numbers[place])) for place in can}
        for place, each in expected.items():
            np.testing.assert_allclose(buffer.rows[place], each, rtol=1e-9, err_msg="a rate that is not central")
            assert buffer.numbers[place] not in changed | {number - 1 for number in changed}, "a rate spans a change"
        of_load = gram([each for place, each in expected.items() if place >= buffer.start], WIDTH)
        assert_moments(buffer, gram(list(expected.values()), WIDTH), of_load)
