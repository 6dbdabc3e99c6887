"""Undirected communication graphs, and how fast consensus converges on them.

A graph is a mapping from each name to the sorted tuple of its neighbours' names.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from coheft.errors import CoheftError
from coheft.estimation.geometry.spatial import Array
from coheft.wire.messages.limits import PER_MESSAGE

if TYPE_CHECKING:  # the library needs no scenarios
    from coheft.wire.scenario.schema import Graph

Neighbours = Mapping[str, tuple[str, ...]]
LARGE_GRAPH = 64
"""For more names, distances are bounded, and exact sums use a tree, in which a message carries two values instead of
those of all rounds."""
_CENTRE_CANDIDATES = 8
"""In a graph of more than ``LARGE_GRAPH`` names, ``centre`` evaluates at most this many candidates."""


class GraphError(CoheftError):
    """A graph cannot serve as a network."""


def build_graph(graph: Graph, names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Return the neighbours of every name, for the kind of graph that a scenario specifies.

    Raises:
        GraphError: Fewer than two names.
    """
    n = len(names)
    if n < 2:
        raise GraphError(f"{n} robot{'s' * (n != 1)} given, but a network needs at least 2")
    edges: set[tuple[int, int]]
    match graph.kind:
        case "ring":
            edges = {(i, (i + 1) % n) for i in range(n)}
        case "line":
            edges = {(i, i + 1) for i in range(n - 1)}
        case "star":
            edges = {(0, i) for i in range(1, n)}
        case "grid":
            columns = math.isqrt(n - 1) + 1
            edges = {(i, i + 1) for i in range(n - 1) if (i + 1) % columns}
            edges |= {(i - columns, i) for i in range(columns, n)}
        case "tree":
            edges = {((i - 1) // graph.branches, i) for i in range(1, n)}
        case "complete":
            edges = set(combinations(range(n), 2))
        case "random":
            edges = _random_connected(n, graph.edge_probability, np.random.default_rng(graph.seed))
    neighbours: dict[str, set[str]] = {name: set() for name in names}
    for i, j in edges:
        neighbours[names[i]].add(names[j])
        neighbours[names[j]].add(names[i])
    return {name: tuple(sorted(others)) for name, others in neighbours.items()}


def _random_connected(n: int, probability: float, rng: np.random.Generator) -> set[tuple[int, int]]:
    """Return the edges of a random recursive tree, plus every other edge with the given probability."""
    order = rng.permutation(n)
    edges = {(int(order[rng.integers(k)]), int(order[k])) for k in range(1, n)}
    present = {frozenset(edge) for edge in edges}
    for pair in combinations(range(n), 2):
        if rng.random() < probability and frozenset(pair) not in present:
            edges.add(pair)
    return edges


def check_graph(neighbours: Neighbours) -> None:
    """Check that agents can reach a consensus over this graph.

    Raises:
        GraphError: There is no agent, an agent is its own neighbour, an edge has one direction only, or not all agents
            are connected.
    """
    if not neighbours:
        raise GraphError("the graph is empty: give each agent's name with those of its neighbours")
    for name, others in neighbours.items():
        for other in others:
            if other == name:
                raise GraphError(f"{name} is its own neighbour")
            if name not in neighbours.get(other, ()):
                raise GraphError(f"{other} is a neighbour of {name}, so {name} has to be one of {other}, too")
    hops = distances(neighbours, first := next(iter(neighbours)))
    if missing := ", ".join(sorted(set(neighbours) - set(hops))):
        raise GraphError(f"the graph is not connected: {first} does not reach {missing}")


def distances(neighbours: Neighbours, source: str) -> dict[str, int]:
    """Return the number of hops from ``source`` to every name that it reaches."""
    hops = {source: 0}
    queue = deque([source])
    while queue:
        name = queue.popleft()
        for other in neighbours.get(name, ()):
            if other not in hops:
                hops[other] = hops[name] + 1
                queue.append(other)
    return hops


def diameter(neighbours: Neighbours) -> int:
    """Return the largest number of hops between two names; for more than ``LARGE_GRAPH`` names a bound, at most twice
    as large.

    Raises:
        GraphError: The graph is not connected.
    """
    longest = 0
    is_small = len(neighbours) <= LARGE_GRAPH
    for name in neighbours if is_small else [centre(neighbours)]:
        hops = distances(neighbours, name)
        if len(hops) != len(neighbours):
            missing = ", ".join(sorted(set(neighbours) - set(hops)))
            raise GraphError(f"the graph is not connected: {name} does not reach {missing}")
        longest = max(longest, *hops.values())
    return longest if is_small else 2 * longest


def flood_delay(neighbours: Neighbours) -> int:
    """Return the number of blocks after which every robot has received what all robots sent at one time.

    This is the diameter, plus one block so that a lost message does no harm, plus the further messages that the
    records of all robots take.
    """
    return diameter(neighbours) + 1 + len(neighbours) // PER_MESSAGE


def centre(neighbours: Neighbours) -> str:
    """Return the centre: the name with the smallest largest distance, the first one of several.

    For more than ``LARGE_GRAPH`` names the result is approximate (exact on trees): the best candidate in the middle
    of the shortest paths between two distant names. The exact result would need the distances between all pairs.
    """
    candidates: Iterable[str] = neighbours
    if len(neighbours) > LARGE_GRAPH:
        end = _farthest(distances(neighbours, min(neighbours)))
        from_end = distances(neighbours, end)
        far = _farthest(from_end)
        from_far = distances(neighbours, far)
        length = from_end[far]
        halves = (length // 2, length - length // 2)
        middle = [name for name, hops in from_end.items() if hops in halves and hops + from_far[name] == length]
        candidates = sorted(middle)[:: -(-len(middle) // _CENTRE_CANDIDATES)]
    return min(candidates, key=lambda name: (max(distances(neighbours, name).values()), name))


def _farthest(hops: Mapping[str, int]) -> str:
    return min(hops, key=lambda name: (-hops[name], name))


def laplacian(neighbours: Neighbours) -> Array:
    """Return the graph Laplacian, degrees minus adjacency, shape (N, N), in the order of the mapping."""
    index = {name: i for i, name in enumerate(neighbours)}
    matrix = np.zeros((len(index), len(index)))
    for name, others in neighbours.items():
        matrix[index[name], index[name]] = len(others)
        for other in others:
            matrix[index[name], index[other]] = -1.0
    return matrix


def metropolis_weight(degree_i: int, degree_j: int) -> float:
    """Return the Metropolis weight of an edge; consensus then converges on every connected graph (Xiao, Boyd, Lall
    2005).
    """
    return 1.0 / (1.0 + max(degree_i, degree_j))


def uniform_weight(neighbours: Neighbours) -> float:
    """Return one weight for all edges with which ``x_i' = sum_j (x_j - x_i)`` converges."""
    return 1.0 / (1.0 + max(map(len, neighbours.values())))


def metropolis_matrix(neighbours: Neighbours) -> Array:
    """Return the matrix of one round of consensus with Metropolis weights, shape (N, N), in the order of the
    mapping.

    Raises:
        GraphError: See ``check_graph``.
    """
    return weight_matrix(neighbours, lambda i, j: metropolis_weight(len(neighbours[i]), len(neighbours[j])))


def weight_matrix(neighbours: Neighbours, weight: Callable[[str, str], float]) -> Array:
    """Return the matrix of one round of consensus with given edge weights, shape (N, N), in the order of the
    mapping.

    Raises:
        GraphError: See ``check_graph``.
    """
    index = {name: i for i, name in enumerate(neighbours)}
    check_graph(neighbours)
    matrix = np.eye(len(index))
    for name, others in neighbours.items():
        for other in others:
            matrix[index[name], index[other]] = weight(name, other)
            matrix[index[name], index[name]] -= weight(name, other)
    return matrix


def place_variances(matrix: Array) -> Array:
    """Return the effect of errors in transports, as variances of each agent's position for unit errors.

    Transports ``X_ij (I + E_ij)``, with ``E_ij = -E_ji`` in common coordinates, are not consistent around cycles. To
    first order, consensus behaves as with ``X_ij (I + P_i - P_j)``, where ``P`` solves ``sum_j W_ij (P_i - P_j - E_ij)
    = 0`` and has zero mean: the weighted least-squares solution over all edges.

    Args:
        matrix: One round of consensus, ``W``, symmetric, shape (N, N).

    Returns:
        Variance of each ``P_i`` if all ``E_ij`` are independent with variance 1, shape (N,).
    """
    weights = matrix - np.diag(matrix.diagonal())
    squares = weights**2
    inverse = np.linalg.pinv(np.diag(weights.sum(axis=1)) - weights, hermitian=True)
    edge_variances = np.diag(squares.sum(axis=1)) - squares
    return np.asarray(np.diag(inverse @ edge_variances @ inverse))


def convergence_rate(matrix: Array) -> float:
    """Return the asymptotic factor by which each round reduces the disagreement.

    Args:
        matrix: One round, symmetric, with rows that sum to 1, shape (N, N), such as ``metropolis_matrix``.

    Returns:
        The second largest eigenvalue in magnitude.
    """
    return float(np.sort(np.abs(np.linalg.eigvalsh(matrix)))[-2])
