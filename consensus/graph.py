"""Undirected communication graphs: neighbours, and the convergence of consensus on them.

A graph is a mapping from each name to the sorted tuple of its neighbours' names.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import combinations

import numpy as np

from coheft.errors import CoheftError
from coheft.estimation.geometry.spatial import Array
from coheft.wire.messages.size import MANY, PER_MESSAGE
from coheft.wire.scenario.schema import Graph

Neighbours = Mapping[str, tuple[str, ...]]
_TRIED = 8
"""In a network of more than ``MANY`` names no robot looks at all pairs of them: so many are tried as its centre."""


class GraphError(CoheftError):
    """A graph cannot serve as a network."""


def build_graph(graph: Graph, names: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Neighbours of every name, for the kind of graph that a scenario asks for.

    Raises:
        GraphError: Fewer than two names.
    """
    n = len(names)
    if n < 2:
        raise GraphError(f"{n} robot{'s' * (n != 1)} given, but a network takes at least 2")
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
    """A random recursive tree, and every further edge with the given probability."""
    order = rng.permutation(n)
    edges = {(int(order[rng.integers(k)]), int(order[k])) for k in range(1, n)}
    present = {frozenset(edge) for edge in edges}
    for pair in combinations(range(n), 2):
        if rng.random() < probability and frozenset(pair) not in present:
            edges.add(pair)
    return edges


def distances(neighbours: Neighbours, source: str) -> dict[str, int]:
    """Hops from ``source`` to every name that it reaches."""
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
    """Largest number of hops between two names; for more than ``MANY`` names a bound, at most twice as large.

    Raises:
        GraphError: The graph is not connected.
    """
    longest = 0
    is_small = len(neighbours) <= MANY
    for name in neighbours if is_small else [centre(neighbours)]:
        hops = distances(neighbours, name)
        if len(hops) != len(neighbours):
            missing = ", ".join(sorted(set(neighbours) - set(hops)))
            raise GraphError(f"the graph is not connected: {name} does not reach {missing}")
        longest = max(longest, *hops.values())
    return longest if is_small else 2 * longest


def hearing(neighbours: Neighbours) -> int:
    """Number of blocks until every robot has received what all sent at one time.

    Whoever is farthest has heard a diameter later; one block more, so that a lost message does no harm, and as many as
    it takes a table with a row for each robot beyond the first message.
    """
    return diameter(neighbours) + 1 + len(neighbours) // PER_MESSAGE


def centre(neighbours: Neighbours) -> str:
    """The name from which the farthest is nearest, the first of several; among more than ``MANY`` one close to it.

    Of many names, it is the best of some in the middle of shortest ways between two that are far apart: where the graph
    is a tree, that is exact. Looking at all would take every robot's distances to all.
    """
    candidates: Iterable[str] = neighbours
    if len(neighbours) > MANY:
        end = _farthest(distances(neighbours, min(neighbours)))
        from_end = distances(neighbours, end)
        far = _farthest(from_end)
        from_far = distances(neighbours, far)
        way = from_end[far]
        halves = (way // 2, way - way // 2)
        middle = [name for name, hops in from_end.items() if hops in halves and hops + from_far[name] == way]
        candidates = sorted(middle)[:: -(-len(middle) // _TRIED)]
    return min(candidates, key=lambda name: (max(distances(neighbours, name).values()), name))


def _farthest(hops: Mapping[str, int]) -> str:
    return min(hops, key=lambda name: (-hops[name], name))


def laplacian(neighbours: Neighbours) -> Array:
    """Graph Laplacian, degrees minus adjacency, shape (N, N), in the order of the mapping."""
    index = {name: i for i, name in enumerate(neighbours)}
    matrix = np.zeros((len(index), len(index)))
    for name, others in neighbours.items():
        matrix[index[name], index[name]] = len(others)
        for other in others:
            matrix[index[name], index[other]] = -1.0
    return matrix


def metropolis_weight(degree_i: int, degree_j: int) -> float:
    """Weight of an edge such that consensus converges on every connected graph (Xiao, Boyd, Lall 2005)."""
    return 1.0 / (1.0 + max(degree_i, degree_j))


def uniform_weight(neighbours: Neighbours) -> float:
    """One weight for all edges, such that consensus converges: the step of ``x_i' = sum_j (x_j - x_i)``."""
    return 1.0 / (1.0 + max(map(len, neighbours.values())))


def metropolis_matrix(neighbours: Neighbours) -> Array:
    """One round of consensus with Metropolis weights as a matrix, shape (N, N), in the order of the mapping."""
    return weight_matrix(neighbours, lambda i, j: metropolis_weight(len(neighbours[i]), len(neighbours[j])))


def weight_matrix(neighbours: Neighbours, weight: Callable[[str, str], float]) -> Array:
    """One round of consensus with any weights of the edges as a matrix, shape (N, N), in the order of the mapping."""
    index = {name: i for i, name in enumerate(neighbours)}
    matrix = np.eye(len(index))
    for name, others in neighbours.items():
        for other in others:
            matrix[index[name], index[other]] = weight(name, other)
            matrix[index[name], index[name]] -= weight(name, other)
    return matrix


def convergence_rate(matrix: Array) -> float:
    """Factor by which every round reduces the disagreement, once only the slowest part is left.

    Args:
        matrix: One round, symmetric, with rows that add up to 1, shape (N, N), such as ``metropolis_matrix``.

    Returns:
        The second largest eigenvalue in magnitude.
    """
    return float(np.sort(np.abs(np.linalg.eigvalsh(matrix)))[-2])
