"""Graphs: every kind is what its name says, and consensus converges on it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, get_type_hints

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coheft.consensus.graph import (
    GraphError,
    Neighbours,
    build_graph,
    centre,
    diameter,
    distances,
    flood_delay,
    laplacian,
    metropolis_matrix,
    metropolis_weight,
    place_variances,
    uniform_weight,
)
from coheft.consensus.schedule import chebyshev, choose_schedule, finite_time, tree
from coheft.wire.messages.limits import PER_MESSAGE
from coheft.wire.scenario.schema import Graph, GraphKind

Kind = Literal["ring", "line", "star", "grid", "tree", "complete", "random"]
KINDS: tuple[Kind, ...] = get_type_hints(Graph)["kind"].__args__

graphs = st.builds(
    lambda kind, n, probability, seed: build_graph(Graph(kind=kind, edge_probability=probability, seed=seed), names(n)),
    st.sampled_from(KINDS),
    st.integers(2, 16),
    st.floats(0.0, 1.0),
    st.integers(0, 10**6),
)


def names(n: int) -> list[str]:
    return [f"r{i:02d}" for i in range(n)]


def edge_count(graph: Neighbours) -> int:
    return sum(len(others) for others in graph.values()) // 2


@pytest.mark.parametrize(
    ("kind", "n", "edges", "longest"),
    [
        ("ring", 2, 1, 1),
        ("ring", 3, 3, 1),
        ("ring", 6, 6, 3),
        ("line", 2, 1, 1),
        ("line", 5, 4, 4),
        ("star", 5, 4, 2),
        ("grid", 12, 17, 5),
        ("grid", 48, 82, 12),
        ("tree", 21, 20, 4),
        ("complete", 5, 10, 1),
    ],
)
def test_kinds(kind: Kind, n: int, edges: int, longest: int) -> None:
    graph = build_graph(Graph(kind=kind), names(n))
    assert edge_count(graph) == edges
    assert diameter(graph) == longest


@given(graphs)
def test_graphs_are_undirected_connected_and_sorted(graph: Neighbours) -> None:
    for name, others in graph.items():
        assert name not in others
        assert list(others) == sorted(set(others))
        assert all(name in graph[other] for other in others)
        assert len(distances(graph, name)) == len(graph)
    assert 1 <= diameter(graph) < len(graph)


@given(st.integers(2, 16), st.integers(0, 10**6))
def test_random_graphs_span_from_trees_to_complete(n: int, seed: int) -> None:
    sparse = build_graph(Graph(kind="random", edge_probability=0.0, seed=seed), names(n))
    dense = build_graph(Graph(kind="random", edge_probability=1.0, seed=seed), names(n))
    assert edge_count(sparse) == n - 1
    assert dense == build_graph(Graph(kind="complete"), names(n))
    assert sparse == build_graph(Graph(kind="random", edge_probability=0.0, seed=seed), names(n))


@given(graphs)
def test_laplacian(graph: Neighbours) -> None:
    matrix = laplacian(graph)
    np.testing.assert_array_equal(matrix, matrix.T)
    np.testing.assert_array_equal(matrix.sum(axis=0), 0.0)
    np.testing.assert_array_equal(np.diag(matrix), [len(others) for others in graph.values()])
    eigenvalues = np.linalg.eigvalsh(matrix)
    assert abs(eigenvalues[0]) < 1e-12 < 1e-3 < eigenvalues[1]  # connected


@given(graphs)
def test_metropolis_matrix_is_doubly_stochastic_and_converges(graph: Neighbours) -> None:
    matrix = metropolis_matrix(graph)
    np.testing.assert_array_equal(matrix, matrix.T)
    np.testing.assert_allclose(matrix.sum(axis=0), 1.0, atol=1e-15)
    assert (matrix >= -1e-15).all()
    others = np.linalg.eigvalsh(matrix - 1.0 / len(graph))
    assert np.abs(others).max() < 1.0 - 1e-4


def test_metropolis_weight_is_the_same_at_both_ends() -> None:
    assert metropolis_weight(2, 5) == metropolis_weight(5, 2) == pytest.approx(1.0 / 6.0)


@pytest.mark.parametrize("kind", ["ring", "star", "line", "complete"])
def test_one_weight_for_all_edges_converges(kind: GraphKind) -> None:
    graph = build_graph(Graph(kind=kind), names(7))
    others = np.linalg.eigvalsh(np.eye(7) - uniform_weight(graph) * laplacian(graph) - 1.0 / 7.0)
    assert np.abs(others).max() < 1.0 - 1e-2


@pytest.mark.parametrize("count", [0, 1])
def test_one_robot_is_no_network(count: int) -> None:
    with pytest.raises(GraphError, match=f"{count} robots? given, but a network needs at least 2"):
        build_graph(Graph(), names(count))


def test_graphs_that_are_not_connected_are_told() -> None:
    with pytest.raises(GraphError, match="a does not reach c, d"):
        diameter({"a": ("b",), "b": ("a",), "c": ("d",), "d": ("c",)})


@pytest.mark.parametrize(
    "reach", [choose_schedule, finite_time, tree, metropolis_matrix, lambda graph: chebyshev(graph, 1e-9)]
)
@pytest.mark.parametrize(
    ("graph", "what"),
    [
        ({}, "the graph is empty"),
        ({"a": ("a", "b"), "b": ("a",)}, "a is its own neighbour"),
        ({"a": ("b",), "b": ()}, "b is a neighbour of a, so a has to be one of b, too"),
        ({"a": ("z",)}, "z is a neighbour of a"),
        ({"a": ("b",), "b": ("a",), "c": ("d",), "d": ("c",)}, "not connected: a does not reach c, d"),
    ],
)
def test_a_graph_without_consensus_is_refused(
    reach: Callable[[Neighbours], object], graph: Neighbours, what: str
) -> None:
    with pytest.raises(GraphError, match=what):
        reach(graph)


def test_an_agent_alone_has_its_sum_at_once() -> None:
    schedule = choose_schedule({"a": ()})
    assert (schedule.rounds, schedule.scale) == (0, 1.0)


@pytest.mark.parametrize("kind", ["ring", "line", "star", "grid", "tree"])
def test_what_is_said_of_large_graphs_without_looking_at_all_pairs(kind: Kind) -> None:
    graph = build_graph(Graph(kind=kind), [f"r{i:03d}" for i in range(200)])
    farthest = {name: max(distances(graph, name).values()) for name in graph}
    assert farthest[centre(graph)] <= min(farthest.values()) + 1
    assert max(farthest.values()) <= diameter(graph) <= 2 * max(farthest.values())
    assert flood_delay(graph) > diameter(graph) + len(graph) // PER_MESSAGE
    apart = {name: tuple(other for other in others if other != "r050") for name, others in graph.items()}
    apart["r050"] = ()
    with pytest.raises(GraphError, match="not connected"):
        diameter(apart)


@pytest.mark.parametrize("kind", ["line", "star", "tree"])
def test_the_centre_of_a_large_tree_is_exact(kind: Kind) -> None:
    graph = build_graph(Graph(kind=kind, branches=3), [f"r{i:03d}" for i in range(130)])
    farthest = {name: max(distances(graph, name).values()) for name in graph}
    assert farthest[centre(graph)] == min(farthest.values())


@given(graphs, st.integers(0, 1000))
def test_transports_that_are_off_act_as_agents_that_stand_elsewhere(graph: Neighbours, seed: int) -> None:
    """Numbers that move when they are carried: consensus on (1, x) with transports off by E, to first order in E."""
    tiny, rng = 1e-6, np.random.default_rng(seed)
    order, matrix = list(graph), metropolis_matrix(graph)
    off = np.triu(rng.normal(size=matrix.shape), 1)
    off = (off - off.T) * (matrix > 0.0)
    values = np.zeros(len(order))  # x_i, carried by X_ij: x_j + E_ij * 1, and the 1 stays
    for _ in range(3000):
        values = matrix @ values + tiny * (matrix * off).sum(axis=1)
    weights = matrix - np.diag(matrix.diagonal())
    expected = np.linalg.pinv(np.diag(weights.sum(axis=1)) - weights) @ (weights * off).sum(axis=1)
    np.testing.assert_allclose(values / tiny, expected, atol=1e-4)


def test_their_variances_are_those_of_least_squares() -> None:
    """A line of three with independent errors of 1: the ends are off by 2/3 and 1/3 of the edges, the middle by 1/3."""
    line = {"a": ("b",), "b": ("a", "c"), "c": ("b",)}
    np.testing.assert_allclose(place_variances(metropolis_matrix(line)), [5 / 9, 2 / 9, 5 / 9])
    ring = build_graph(Graph(kind="ring"), names(6))
    np.testing.assert_allclose(place_variances(metropolis_matrix(ring)), 35 / 72)
