"""The buffer of rows, against a list of rows that is summed anew each time."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coheft.estimation.moments.moments import ProjectedMoments, RowMoments, evaluated_moments
from coheft.estimation.moments.row_buffer import RowBuffer
from tests.estimation.moments.moving_team import LATE, body_at, make_team, with_rates
from tests.estimation.moments.numbered_rows import SIZE, assert_moments, gram, row

LEAST_KEPT = 6
pytestmark = pytest.mark.usefixtures("few_rows_are_kept")


@dataclass
class Naive:
    """Numbers of all rows that count, those before ``since`` of former loads."""

    former: list[int] = field(default_factory=list)
    load: list[int] = field(default_factory=list)
    kept: list[int] = field(default_factory=list)
    begin: int = 0
    since: int = 0

    def add(self, number: int) -> None:
        if len(self.kept) == 2 * LEAST_KEPT:
            self.begin = max(self.begin, self.kept[LEAST_KEPT])  # no row comes so late
            del self.kept[:LEAST_KEPT]
        self.kept = sorted([*self.kept, number])
        (self.former if number < self.since else self.load).append(number)

    def place_of_load(self) -> int:
        return sum(number < self.since for number in self.kept)

    def begin_load(self, index: int) -> list[int]:
        self.since = self.kept[index] if index < len(self.kept) else self.kept[-1] + 1
        last = [number for number in self.load if number < self.since]
        self.former += last
        self.load = [number for number in self.load if number >= self.since]
        return last

    def begin_chapter(self, index: int) -> tuple[list[int], list[int]]:
        self.begin = self.kept[index] if index < len(self.kept) else self.kept[-1] + 1
        gone = [number for number in self.load if number < self.begin]
        everything = self.former + gone
        self.load = [number for number in self.load if number >= self.begin]
        self.former, self.kept, self.since = [], self.kept[index:], self.begin
        return everything, gone

    def take_back(self, number: int) -> int:
        taken = {each for each in self.kept if each >= number and each >= self.since}
        self.kept = [each for each in self.kept if each not in taken]
        self.load = [each for each in self.load if each not in taken]
        return len(taken)


OPERATIONS = st.lists(
    st.tuples(
        st.sampled_from(["next", "next", "next", "gap", "late", "late", "load", "chapter", "back", "look"]),
        st.floats(0.0, 1.0),
    ),
    min_size=30,
    max_size=60,
)


@given(OPERATIONS)
def test_moments_are_sums_over_rows_whatever_happens(operations: list[tuple[str, float]]) -> None:
    buffer, naive, newest, missing = RowBuffer(SIZE), Naive(), 2, [0, 1, 2]
    for what, share in operations:
        start, count = naive.place_of_load(), len(naive.kept)
        index = start + round(share * (count - start))
        missing = [number for number in missing if number >= naive.begin]
        if what in ("next", "gap") or (what == "late" and missing and count < 2 * LEAST_KEPT):
            if what == "late":
                number = missing.pop(round(share * (len(missing) - 1)))
            else:
                number = newest + (1 if what == "next" else 2 + round(2 * share))
                missing += range(newest + 1, number)
            newest = max(newest, number)
            is_full = count == 2 * LEAST_KEPT
            found, had_to_drop = buffer.add(number, row(number))
            naive.add(number)
            assert had_to_drop == is_full
            assert found == naive.kept.index(number)
        elif what == "load" and count:
            last = buffer.begin_load(index)
            np.testing.assert_allclose(
                last.sums(SIZE - 1), gram(list(map(row, naive.begin_load(index))))[-1], atol=1e-9
            )
        elif what == "chapter" and count:
            found_gone, expected_gone = buffer.begin_chapter(index), naive.begin_chapter(index)
            for one, other in zip(found_gone, expected_gone, strict=True):
                assert isinstance(one, RowMoments)
                np.testing.assert_allclose(one.matrix, gram(list(map(row, other))), atol=1e-9)
        elif what == "back":
            number = newest - round(6 * share)
            assert buffer.take_back(number) == naive.take_back(number)
            come_back = range(max(number + 1, 0), newest + 1)
            missing = sorted({*missing, *(each for each in come_back if each not in naive.kept)})
            if not naive.load:  # then no row of a former load comes any more
                naive.begin = max(naive.begin, naive.since)
        elif what == "look":
            load = gram(list(map(row, naive.load)))
            assert_moments(buffer, load + gram(list(map(row, naive.former))), load)
            newer = buffer.moments_since(index)
            assert isinstance(newer, RowMoments)
            np.testing.assert_allclose(newer.matrix, gram(list(map(row, naive.kept[index:]))), atol=1e-9)
        assert buffer.numbers[: buffer.count].tolist() == naive.kept
        assert buffer.start == naive.place_of_load()
        assert buffer.load_rows == len(naive.load)
    load = gram(list(map(row, naive.load)))
    assert_moments(buffer, load + gram(list(map(row, naive.former))), load)


@given(st.permutations(range(10)), st.integers(0, 10))
def test_the_order_in_which_rows_come_does_not_matter(numbers: list[int], changed: int) -> None:
    buffer = RowBuffer(SIZE)
    for number in (100, 101):
        buffer.add(number, row(number))
    buffer.moments()
    for number in numbers[:changed]:
        buffer.add(number, row(number))
    if changed:
        buffer.moments()
    for number in numbers[changed:]:
        buffer.add(number, row(number))
    everything = gram([row(number) for number in [*range(10), 100, 101]])
    assert_moments(buffer, everything, everything)
    assert buffer.moments()[0] is buffer.moments()[1]
    np.testing.assert_array_equal(buffer.rows[:12], [row(number) for number in [*range(10), 100, 101]])


def test_a_row_from_before_the_load_or_the_chapter_comes_late() -> None:
    buffer = RowBuffer(SIZE)
    for number in (0, 1, 3, 4, 5, 7, 8):
        buffer.add(number, row(number))
    buffer.begin_load(4)
    assert buffer.add(2, row(2)) == (2, False)
    assert (buffer.start, buffer.load_rows) == (5, 3)
    assert_moments(buffer, gram([row(n) for n in (0, 1, 2, 3, 4, 5, 7, 8)]), gram([row(n) for n in (5, 7, 8)]))
    buffer.begin_chapter(6)
    assert buffer.add(6, row(6)) == (0, False)
    assert_moments(buffer, gram([row(n) for n in (7, 8)]), gram([row(n) for n in (7, 8)]))
    assert buffer.load_rows == 2


def test_moments_of_large_teams_are_kept_as_seen_from_one_state() -> None:
    team = make_team(seed=1, number=40)
    rows = with_rates(team.rows)
    body, far = body_at(team.state(LATE), LATE), body_at(make_team(seed=2).state(LATE), LATE)
    buffer = RowBuffer(rows.shape[1], is_projected=True)
    for number, each in enumerate(rows):
        buffer.add(number, each)
        if number == 2:
            buffer.project_at(far)  # too few rows, so poses are not known yet
            assert isinstance(buffer.moments()[0], RowMoments)
        elif number in (10, 30):  # all are kept at first; later only their moments
            buffer.project_at(body)
    found, of_load = buffer.moments()
    assert isinstance(found, ProjectedMoments)
    assert found.body is body
    assert found is of_load
    seen, exact = evaluated_moments(body, found, of_load), RowMoments.of(rows)
    expected = evaluated_moments(body, exact, exact)
    for kind in ("motion", "wrench"):
        for name, value in vars(getattr(expected, kind)).items():
            np.testing.assert_allclose(getattr(getattr(seen, kind), name), value, rtol=1e-7, atol=1e-3, err_msg=name)


def test_moments_of_small_teams_are_those_of_rows() -> None:
    team = make_team(seed=1, number=10)
    buffer = RowBuffer(team.rows.shape[1])
    for number, each in enumerate(team.rows):
        buffer.add(number, each)
    buffer.project_at(body_at(team.state()))
    assert isinstance(buffer.moments()[0], RowMoments)


@pytest.mark.parametrize("has_former", [False, True])
def test_moments_of_rows_that_are_not_kept_can_be_seen_from_the_first_state(has_former: bool) -> None:
    team = make_team(seed=3, number=40)
    body, buffer = body_at(team.state()), RowBuffer(team.rows.shape[1], is_projected=True)
    for number, each in enumerate(team.rows):
        buffer.add(number, each)
        if number == 20 and has_former:
            buffer.begin_load(10)
    buffer.project_at(body)  # the oldest rows have made room by now
    everything, load = buffer.moments()
    assert isinstance(everything, ProjectedMoments)
    assert (everything is load) != has_former
    expected = RowMoments.of(team.rows).with_motion(body)
    np.testing.assert_allclose(everything.with_motion(body), expected, rtol=1e-7, atol=1e-3)


def test_after_a_chapter_all_moments_are_projected_anew_at_each_state() -> None:
    team = make_team(seed=3, number=40)
    rows = team.rows + 0.1 * np.random.default_rng(0).normal(size=team.rows.shape)  # of noise, conversion is inexact
    first, second = body_at(make_team(seed=4).state()), body_at(team.state())
    buffer = RowBuffer(rows.shape[1], is_projected=True)
    for number, each in enumerate(rows[:30]):
        buffer.add(number, each)
    buffer.project_at(first)
    buffer.begin_chapter(buffer.index_of(25))
    for number, each in enumerate(rows[30:34], 30):
        buffer.add(number, each)
    buffer.project_at(second)
    everything, _ = buffer.moments()
    expected = RowMoments.of(rows[25:34]).with_motion(second)
    np.testing.assert_allclose(everything.with_motion(second), expected, rtol=1e-7, atol=1e-3)
