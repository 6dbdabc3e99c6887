"""Rows reach every robot over one-hop messages, in any order, and whatever else neighbours send makes no difference."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coheft.agents.efficient.exchange import WINDOW, Exchange, RowMessage
from coheft.agents.efficient.row_times import RowTimes
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.rows import ROW_SIZE

TEAM, COUNT = 77, 4
HOPS = COUNT - 1
EACH_BLOCK, TWO_PER_BLOCK = RowTimes(10, 10), RowTimes(10, 5)


def row_of(robot: int, number: int) -> Array:
    return np.full(ROW_SIZE, 100.0 * robot + number)


def expected(number: int) -> Array:
    return np.append(np.concatenate([row_of(robot, number) for robot in range(COUNT)]), 1.0)


def line() -> list[Exchange]:
    return [Exchange(TEAM, COUNT, own, HOPS, EACH_BLOCK) for own in range(COUNT)]


def neighbours(robot: int) -> list[int]:
    return [other for other in (robot - 1, robot + 1) if 0 <= other < COUNT]


def run(blocks: int, arrives: Callable[[int, int, int], bool] = lambda block, to, sender: True) -> list[Exchange]:
    """A line of robots; each measures one row per block."""
    team, sent = line(), dict[int, RowMessage]()
    for block in range(blocks):
        for robot, exchange in enumerate(team):
            received_from = [other for other in neighbours(robot) if block and arrives(block, robot, other)]
            exchange.receive([sent[other] for other in received_from], block)
            exchange.add_own(block, row_of(robot, block))
        sent = {robot: exchange.message(-1) for robot, exchange in enumerate(team)}
    return team


def test_a_row_of_the_whole_team_is_complete_everywhere_after_as_many_blocks_as_hops() -> None:
    blocks = 12
    for exchange in run(blocks):
        found = exchange.complete(blocks - 1 - HOPS)
        assert found is not None
        np.testing.assert_array_equal(found, expected(blocks - 1 - HOPS))
    first = run(blocks)[0]
    assert first.complete(blocks - HOPS) is None
    assert first.missing(blocks - HOPS) == [COUNT - 1]


def test_no_single_lost_message_loses_a_row() -> None:
    for lost in [(block, to, sender) for block in range(2, 6) for to in range(COUNT) for sender in neighbours(to)]:
        for exchange in run(14, arrives=lambda *message, lost=lost: message != lost):
            for number in range(9):
                assert exchange.complete(number) is not None, (lost, number)


def test_a_row_that_never_comes_delays_no_other() -> None:
    team = run(8, arrives=lambda block, to, sender: block not in (3, 4))
    complete = [number for number in range(8) if team[0].complete(number) is not None]
    assert complete
    assert 0 not in complete or 7 not in complete
    assert max(complete) > 3


@given(st.permutations(range(6)))
def test_the_order_in_which_rows_come_makes_no_difference(order: list[int]) -> None:
    exchange = Exchange(TEAM, COUNT, 0, HOPS, EACH_BLOCK)
    for number in order:
        exchange.add_own(number, row_of(0, number))
        labels = np.array([[robot, number] for robot in range(1, COUNT)], dtype=np.int32)
        rows = np.array([row_of(robot, number) for robot in range(1, COUNT)], dtype=np.float32)
        exchange.receive([RowMessage(TEAM, -1, labels, rows)], block=6)
    for number in order:
        np.testing.assert_array_equal(exchange.complete(number), expected(number))


@pytest.mark.parametrize("size", [24, 30, 48, 54, 12, 25, 60])
def test_rows_of_other_sizes_than_there_are_make_no_message(size: int) -> None:
    channels = RowMessage(TEAM, 3, np.array([[1, 2]], dtype=np.int32), np.ones((1, size), dtype=np.float32)).channels()
    assert (RowMessage.of_channels(channels) is not None) == (size in (24, 30, 48, 54))


def heard(exchange: Exchange, label: tuple[int, int], block: int = 10, team: int = TEAM) -> None:
    rows = np.ones((1, ROW_SIZE), dtype=np.float32)
    exchange.receive([RowMessage(team, 5, np.array([label], dtype=np.int32), rows)], block)


@pytest.mark.parametrize("label", [(COUNT, 9), (-1, 9), (1, 10), (1, 99), (1, -1), (1, 10 - WINDOW)])
def test_rows_of_unknown_robots_of_the_future_and_of_long_ago_are_left_out(label: tuple[int, int]) -> None:
    exchange = Exchange(TEAM, COUNT, 0, HOPS, EACH_BLOCK)
    heard(exchange, label)
    assert len(exchange.message(-1).rows) == 0


def test_rows_with_impossible_numbers_are_left_out() -> None:
    exchange = Exchange(TEAM, COUNT, 0, HOPS, EACH_BLOCK)
    rows = np.full((1, ROW_SIZE), 1e8, dtype=np.float32)
    exchange.receive([RowMessage(TEAM, -1, np.array([(1, 9)], dtype=np.int32), rows)], block=10)
    assert len(exchange.message(-1).rows) == 0


def test_rows_and_news_of_another_team_are_left_out() -> None:
    exchange = Exchange(TEAM, COUNT, 0, HOPS, EACH_BLOCK)
    heard(exchange, (1, 9), team=TEAM + 1)
    assert len(exchange.message(-1).rows) == 0
    assert exchange.news_at == -1


def test_the_first_row_of_a_robot_and_block_counts() -> None:
    exchange = Exchange(TEAM, COUNT, 0, HOPS, EACH_BLOCK)
    heard(exchange, (1, 9))
    again = RowMessage(TEAM, -1, np.array([[1, 9]], dtype=np.int32), np.full((1, ROW_SIZE), 7, dtype=np.float32))
    exchange.receive([again], 10)
    assert exchange.message(-1).rows.tolist() == np.ones((1, ROW_SIZE)).tolist()


@pytest.mark.parametrize("at_once", [False, True])
def test_neighbours_that_send_the_same_row_are_heard_as_if_one_had_sent_it(at_once: bool) -> None:
    exchange = Exchange(TEAM, COUNT, 0, HOPS, EACH_BLOCK)
    labels = np.array([[1, 9], [2, 9], [1, 8]], dtype=np.int32)
    rows = np.array([row_of(*label) for label in labels.tolist()], dtype=np.float32)
    message = RowMessage(TEAM, -1, labels, rows)
    other = RowMessage(TEAM, -1, labels[:2], np.array([rows[0], rows[1] + 1.0], dtype=np.float32))
    for batch in [[message, other]] if at_once else [[message], [other]]:
        exchange.receive(batch, 10)
    sent = exchange.message(-1)
    np.testing.assert_array_equal(sent.labels, labels)
    np.testing.assert_array_equal(sent.rows, rows)
    assert exchange.disputed == {2: 10}


def test_memory_is_bounded_and_each_row_is_told_twice() -> None:
    exchange, sent = Exchange(TEAM, COUNT, 0, HOPS, TWO_PER_BLOCK), []
    for block in range(3 * WINDOW):
        exchange.add_own(2 * block, row_of(0, block))
        exchange.add_own(2 * block + 1, row_of(0, block))
        sent.append(exchange.message(-1).labels[:, 1].tolist())
    assert max(map(len, sent)) == 4
    assert [number for numbers in sent for number in numbers].count(20) == 2


def test_the_newest_change_of_the_load_is_heard_of() -> None:
    exchange = Exchange(TEAM, COUNT, 0, HOPS, EACH_BLOCK)
    nothing = RowMessage(TEAM, 4, np.zeros((0, 2), dtype=np.int32), np.zeros((0, ROW_SIZE), dtype=np.float32))
    exchange.receive([nothing], 10)
    exchange.receive([replace(nothing, news_at=2)], 10)
    assert exchange.news_at == 4
    exchange.receive([replace(nothing, news_at=10)], 10)  # of a row that has not been measured yet
    assert exchange.news_at == 4


def test_a_message_survives_as_arrays_and_anything_else_is_none() -> None:
    message = RowMessage(TEAM, 3, np.array([[1, 2]], dtype=np.int32), np.ones((1, ROW_SIZE), dtype=np.float32))
    channels = message.channels()
    again = RowMessage.of_channels(channels)
    assert again is not None
    assert (again.team, again.news_at) == (TEAM, 3)
    np.testing.assert_array_equal(again.rows, message.rows)
    assert RowMessage.of_channels({}) is None
    for name, array in channels.items():
        for wrong in (array[..., None], array.astype(np.float64)):
            assert RowMessage.of_channels({**channels, name: wrong}) is None


def test_two_different_rows_of_one_robot_for_one_time_are_seen_by_whoever_hears_both() -> None:
    exchange = Exchange(TEAM, COUNT, 0, HOPS, EACH_BLOCK)
    labels = np.array([[2, 5], [3, 5]], dtype=np.int32)
    rows = np.array([row_of(2, 5), row_of(3, 5)], dtype=np.float32)
    message = RowMessage(TEAM, -1, labels, rows)
    exchange.receive([message], block=7)
    exchange.receive([message], block=7)
    assert not exchange.disputed
    other = rows.copy()
    other[1, 4] = np.nextafter(other[1, 4], np.float32(np.inf))
    exchange.receive([replace(message, rows=other)], block=8)
    assert exchange.disputed == {3: 8}
    assert exchange.missing(5) == [0, 1]  # the first one stays


def test_however_often_a_neighbour_repeats_a_wrong_row_it_is_set_aside_once() -> None:
    exchange = Exchange(TEAM, COUNT, 0, HOPS, EACH_BLOCK, sealing=20)
    exchange.receive([RowMessage(TEAM, -1, *labelled(3, 5, 1.0), "r2")], block=6)
    labels, rows = labelled(3, 5, 2.0)
    many = RowMessage(TEAM, -1, np.repeat(labels, 500, axis=0), np.repeat(rows, 500, axis=0), "r2")
    exchange.receive([many, many], block=6)
    assert list(exchange.aside) == [("r2", 3, 5)]
    exchange.receive([], block=6 + exchange.window)
    assert not exchange.aside


def labelled(robot: int, number: int, value: float) -> tuple[np.ndarray, np.ndarray]:
    return np.array([[robot, number]], dtype=np.int32), np.full((1, ROW_SIZE), value, dtype=np.float32)
