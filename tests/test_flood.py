"""Tables that all robots fill in: each one's newest row reaches all others, in as many blocks as it has hops to go."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from coheft.consensus.flood import Flood, Floods
from coheft.consensus.graph import Neighbours, build_graph, diameter, flood_delay
from coheft.estimation.geometry.spatial import Array
from coheft.wire.messages.limits import PER_MESSAGE
from coheft.wire.scenario.schema import Graph
from tests.test_graph import graphs, names

WIDTH = 4


def spread(
    graph: Neighbours, floods: dict[str, Flood], blocks: int, arrives: Callable[[], bool] = lambda: True
) -> list[int]:
    """Let every robot talk with its neighbours. Returns how many tables were sent in each block."""
    sent = []
    for _ in range(blocks):
        messages = {name: (flood.digest, flood.sent()) for name, flood in floods.items()}
        sent.append(sum(table is not None for _, table in messages.values()))
        for name, others in graph.items():
            for other in others:
                if arrives():
                    floods[name].receive(other, *messages[other])
    return sent


def told(graph: Neighbours, stamp: int) -> dict[str, Flood]:
    floods = {name: Flood(len(graph), WIDTH) for name in graph}
    tell(floods, stamp)
    return floods


def tell(floods: dict[str, Flood], stamp: int) -> None:
    for k, flood in enumerate(floods.values()):
        flood.enter(k, stamp, row(k, stamp))


def row(robot: int, stamp: int) -> Array:
    return np.random.default_rng([robot, stamp]).normal(size=WIDTH)


def talked(graph: Neighbours) -> dict[str, Flood]:
    """Tables of robots that have heard each other's digests."""
    floods = {name: Flood(len(graph), WIDTH) for name in graph}
    spread(graph, floods, 2)
    return floods


def assert_everybody_has_all(floods: dict[str, Flood], stamp: int) -> None:
    for flood in floods.values():
        np.testing.assert_array_equal(flood.rows(stamp), [row(k, stamp) for k in range(len(floods))])


@given(graphs)
def test_all_rows_reach_everybody_at_one_hop_per_block(graph: Neighbours) -> None:
    """One block more than the diameter: a table is sent only after a neighbour's is known to be another one."""
    floods = talked(graph)
    tell(floods, 5)
    spread(graph, floods, diameter(graph) - 1)
    assert any(flood.rows(5) is None for flood in floods.values())
    spread(graph, floods, 2)
    assert_everybody_has_all(floods, 5)
    for flood in floods.values():
        assert flood.rows(4) is None
        assert flood.rows(6) is None


@given(graphs)
def test_newer_rows_win(graph: Neighbours) -> None:
    floods = told(graph, 0)
    spread(graph, floods, diameter(graph) + 1)
    assert_everybody_has_all(floods, 0)
    tell(floods, 1)
    assert all(flood.rows(0) is None and flood.rows(1) is None for flood in floods.values())
    spread(graph, floods, diameter(graph) + 1)
    assert_everybody_has_all(floods, 1)


@given(graphs, st.floats(0.1, 0.95), st.integers(0, 10**6))
def test_everybody_has_all_after_any_losses_followed_by_enough_blocks_without(
    graph: Neighbours, loss: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    floods = {name: Flood(len(graph), WIDTH) for name in graph}
    for stamp in range(3):
        tell(floods, stamp)
        spread(graph, floods, 4, arrives=lambda: rng.random() >= loss)
    spread(graph, floods, diameter(graph) + 1)
    assert_everybody_has_all(floods, 2)


@given(graphs)
def test_nothing_is_sent_in_vain(graph: Neighbours) -> None:
    floods = told(graph, 2)
    spread(graph, floods, diameter(graph) + 3)
    assert spread(graph, floods, 3) == [0, 0, 0]
    next(iter(floods.values())).enter(0, 3, row(0, 3))
    assert sum(spread(graph, floods, diameter(graph) + 1)) > 0


def test_tables_of_another_team_are_ignored() -> None:
    flood = Flood(3, WIDTH)
    flood.enter(0, 1, row(0, 1))
    for rows in (
        np.full((4, 2 + WIDTH), 1.0),  # more rows than there are robots
        np.full((3, 1 + WIDTH), 1.0),
        np.full((0, 2 + WIDTH), 1.0),
        np.full(2 + WIDTH, 1.0),
        np.full((1, 2 + WIDTH), 3.0),  # of a robot that is not there
        np.full((1, 2 + WIDTH), -1.0),
        np.full((1, 2 + WIDTH), 0.5),
    ):
        flood.receive("r1", 0.0, rows)
    np.testing.assert_array_equal(flood.table[1:], -1.0)


def test_what_was_sent_does_not_change_any_more() -> None:
    flood = Flood(2, WIDTH)
    flood.receive("r1", 7.0, None)
    sent = flood.sent()
    assert sent is not None
    before = sent.copy()
    flood.enter(0, 1, row(0, 1))
    np.testing.assert_array_equal(sent, before)


def test_tables_travel_together() -> None:
    ours, theirs = ({"a": Flood(2, 1), "b": Flood(2, 3)} for _ in range(2))
    ours["a"].enter(0, 4, np.array([1.0]))
    theirs["b"].enter(1, 5, np.array([1.0, 2.0, 3.0]))
    here, there = Floods(ours), Floods(theirs)
    for _ in range(2):
        from_here, from_there = here.channels(), there.channels()
        here.receive("there", from_there)
        there.receive("here", from_here)
    for name in ("a", "b"):
        np.testing.assert_array_equal(ours[name].table, theirs[name].table)
    assert ours["a"].row(0)[0] == ours["a"].newest == 4
    assert ours["b"].row(1)[0] == ours["b"].newest == 5


def test_a_message_without_digests_or_with_those_of_other_tables_says_nothing() -> None:
    flood = Flood(2, 1)
    floods = Floods({"a": flood})
    table = np.array([[0.0, 7.0, 7.0], [1.0, 7.0, 7.0]])
    floods.receive("there", {"a": table})
    floods.receive("there", {"a": table, "digests": np.array([14.0, 14.0])})
    np.testing.assert_array_equal(flood.table, -1.0)


def test_arrays_of_other_shapes_do_not_fit() -> None:
    floods = Floods({"a": Flood(2, 1)})
    table, digests = np.array([[0.0, 7.0, 7.0]]), np.array([14.0])
    assert floods.fit({})
    assert floods.fit({"a": table, "digests": digests})
    assert not floods.fit({"a": table, "digests": np.array([14.0, 14.0])})
    assert not floods.fit({"a": table[:, :2], "digests": digests})


def test_halves_that_could_not_talk_until_now_tell_each_other_all_though_they_know_equally_much() -> None:
    graph = build_graph(Graph(kind="line"), names(4))
    halves = {name: tuple(o for o in others if (o in names(2)) == (name in names(2))) for name, others in graph.items()}
    floods = told(graph, 0)
    spread(halves, floods, 5)
    assert all(np.count_nonzero(flood.table[:, 0] == 0) == 2 for flood in floods.values())
    spread(graph, floods, diameter(graph) + 1)
    assert_everybody_has_all(floods, 0)


def test_large_tables_travel_in_pieces_as_fast_as_the_flood_delay_says() -> None:
    graph = build_graph(Graph(kind="grid"), names(150))
    floods = talked(graph)
    for stamp in range(3):
        tell(floods, stamp)
        messages = [flood.sent() for flood in floods.values()]
        assert all(rows is not None and len(rows) <= PER_MESSAGE for rows in messages)
        spread(graph, floods, flood_delay(graph))
        assert_everybody_has_all(floods, stamp)
    spread(graph, floods, 2)
    assert spread(graph, floods, 2) == [0, 0]


def test_what_is_lost_of_large_tables_is_told_again() -> None:
    graph = build_graph(Graph(kind="tree", branches=2), names(100))
    floods = talked(graph)
    tell(floods, 0)
    rng = np.random.default_rng(1)
    spread(graph, floods, 20, arrives=lambda: rng.random() >= 0.5)
    assert any(flood.rows(0) is None for flood in floods.values())
    spread(graph, floods, len(graph) // PER_MESSAGE * diameter(graph))
    assert_everybody_has_all(floods, 0)


def test_a_row_with_the_number_of_another_robot_is_not_taken() -> None:
    """Of a small table all rows travel: a number that is wrong can be seen."""
    sender, receiver = Flood(3, WIDTH), Flood(3, WIDTH)
    receiver.receive("b", sender.digest, None)
    sender.enter(0, 5, row(0, 5))
    sender.receive("a", receiver.digest, None)
    rows = sender.sent()
    assert rows is not None
    rows[0, 0] = 2.0
    receiver.receive("b", sender.digest, rows)
    assert np.all(receiver.table[:, 0] == -1.0)
