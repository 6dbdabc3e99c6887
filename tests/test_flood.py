"""Tables that everybody fills in: everybody's newest row reaches everybody, in as many blocks as it has hops to go."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from consensus.flood import Flood
from consensus.graph import Neighbours, diameter
from tests.test_graph import graphs

WIDTH = 4
Edge = tuple[int, str, str]


def spread(graph: Neighbours, floods: dict[str, Flood], blocks: int, lost: frozenset[Edge] = frozenset()) -> None:
    """Messages ``(block, to, sender)`` in ``lost`` do not arrive."""
    for block in range(blocks):
        tables = {name: flood.table for name, flood in floods.items()}
        for name, others in graph.items():
            for other in others:
                if (block, name, other) not in lost:
                    floods[name].hear(tables[other])


def told(graph: Neighbours, stamp: int) -> dict[str, Flood]:
    floods = {name: Flood(len(graph), WIDTH) for name in graph}
    tell(floods, stamp)
    return floods


def tell(floods: dict[str, Flood], stamp: int) -> None:
    for k, flood in enumerate(floods.values()):
        flood.tell(k, stamp, row(k, stamp))


def row(robot: int, stamp: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.random.default_rng([robot, stamp]).normal(size=WIDTH)


@given(graphs)
def test_all_rows_reach_everybody_after_a_diameter_and_not_before(graph: Neighbours) -> None:
    floods = told(graph, 5)
    blocks = diameter(graph)
    spread(graph, floods, blocks - 1)
    assert any(flood.rows(5) is None for flood in floods.values())
    spread(graph, floods, 1)
    expected = np.array([row(k, 5) for k in range(len(graph))])
    for flood in floods.values():
        np.testing.assert_array_equal(flood.rows(5), expected)
        assert flood.rows(4) is None
        assert flood.rows(6) is None


@given(graphs)
def test_newer_rows_win(graph: Neighbours) -> None:
    floods = told(graph, 0)
    spread(graph, floods, diameter(graph))
    tell(floods, 1)
    assert all(flood.rows(0) is None and flood.rows(1) is None for flood in floods.values())
    spread(graph, floods, diameter(graph))
    for flood in floods.values():
        np.testing.assert_array_equal(flood.rows(1), [row(k, 1) for k in range(len(graph))])


@given(graphs, st.data())
def test_a_block_without_any_messages_costs_one_block(graph: Neighbours, data: st.DataObject) -> None:
    blocks = diameter(graph) + 1
    silent = data.draw(st.integers(0, blocks - 1))
    floods = told(graph, 3)
    spread(graph, floods, blocks, frozenset((silent, i, j) for i, others in graph.items() for j in others))
    assert all(flood.rows(3) is not None for flood in floods.values())


def test_tables_of_another_team_are_ignored() -> None:
    flood = Flood(3, WIDTH)
    flood.tell(0, 1, row(0, 1))
    flood.hear(np.full((4, 1 + WIDTH), 9.0))
    flood.hear(np.full((3, WIDTH), 9.0))
    np.testing.assert_array_equal(flood.table[1:], -1.0)


def test_what_was_sent_does_not_change_any_more() -> None:
    flood = Flood(2, WIDTH)
    sent = flood.table
    flood.tell(0, 1, row(0, 1))
    np.testing.assert_array_equal(sent, -1.0)
