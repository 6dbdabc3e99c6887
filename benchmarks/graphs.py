"""Graphs of up to ten thousand nodes in sparse form, and what their spectra say."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array, diags_array
from scipy.sparse.csgraph import shortest_path
from scipy.sparse.linalg import eigsh

from coheft.estimation.geometry.spatial import Array

DENSE = 1100
"""Up to so many nodes all eigenvalues are computed, and the best root of a tree is searched among all."""
_SAME = 1e-7
"""Eigenvalues that differ by less than this share of the largest are one, as in ``coheft.consensus.schedule``."""
_DEGREE = 8
_ROOTS = 100


@dataclass(frozen=True, eq=False)
class Links:
    """An undirected graph.

    Attributes:
        kind: Its shape.
        adjacency: Shape (N, N), of ones.
    """

    kind: str
    adjacency: csr_array[Any, Any]

    @property
    def count(self) -> int:
        """Number of nodes."""
        return int(self.adjacency.shape[0])

    @property
    def degrees(self) -> Array:
        """Number of neighbours of each node."""
        return np.asarray(self.adjacency.sum(axis=1), dtype=np.float64)

    def laplacian(self) -> csr_array[Any, Any]:
        """Degrees minus adjacency."""
        return csr_array(diags_array(self.degrees) - self.adjacency)

    def metropolis(self) -> csr_array[Any, Any]:
        """One round of dynamic consensus."""
        edges = self.adjacency.tocoo()
        rows, columns = edges.coords
        weights = 1.0 / (1.0 + np.maximum(self.degrees[rows], self.degrees[columns]))
        moved = csr_array((weights, (rows, columns)), shape=(self.count, self.count))
        kept = diags_array(1.0 - np.asarray(moved.sum(axis=1), dtype=np.float64))
        return csr_array(moved + kept)

    def neighbours(self) -> dict[str, tuple[str, ...]]:
        """As ``coheft.consensus.graph`` has it."""
        names = [f"r{node:0{len(str(self.count))}d}" for node in range(self.count)]
        return {
            names[node]: tuple(names[other] for other in sorted(self.adjacency[[node], :].indices.tolist()))
            for node in range(self.count)
        }


def ring(count: int) -> Links:
    """Each node with the two beside it."""
    nodes = np.arange(count)
    return Links("ring", _adjacency(count, nodes, (nodes + 1) % count))


def grid(count: int) -> Links:
    """A square, each node with those above, below and beside it; ``count`` has to be a square number."""
    side = math.isqrt(count)
    nodes = np.arange(side * side).reshape(side, side)
    ends = np.hstack([[nodes[:, :-1].ravel(), nodes[:, 1:].ravel()], [nodes[:-1].ravel(), nodes[1:].ravel()]])
    return Links("grid", _adjacency(side * side, *ends))


def random(count: int) -> Links:
    """A random tree and random edges beside it, eight neighbours on average."""
    rng = np.random.default_rng(count)
    later = np.arange(1, count)
    more = rng.integers(count, size=(2, count * _DEGREE // 2 - count))
    more = more[:, more[0] != more[1]]
    earlier = (rng.random(count - 1) * later).astype(np.int64)
    return Links("random graph", _adjacency(count, np.append(earlier, more[0]), np.append(later, more[1])))


def _adjacency(count: int, one: npt.NDArray[np.int64], other: npt.NDArray[np.int64]) -> csr_array[Any, Any]:
    both = (np.append(one, other), np.append(other, one))
    matrix = csr_array((np.ones(len(both[0])), both), shape=(count, count))
    matrix.data[:] = 1.0  # an edge that was drawn twice is one
    return matrix


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Of a Laplacian.

    Attributes:
        low: Smallest eigenvalue beside zero.
        high: Largest one.
        distinct: Number of different eigenvalues beside zero.
        values: These, None where they were not computed.
    """

    low: float
    high: float
    distinct: int
    values: Array | None


def spectrum(links: Links) -> Spectrum:
    """Eigenvalues: all of them, or by formula for large rings and grids; of large random graphs the extreme ones.

    No two eigenvalues of a large random graph are taken to be equal.
    """
    if links.count > DENSE and links.kind == "random graph":
        matrix = links.laplacian()
        low = float(np.sort(eigsh(matrix, k=2, which="SA", return_eigenvectors=False))[-1])
        high = float(eigsh(matrix, k=1, which="LA", return_eigenvectors=False)[0])
        return Spectrum(low, high, links.count - 1, None)
    values = np.linalg.eigvalsh(links.laplacian().toarray()) if links.count <= DENSE else _by_formula(links)
    values = np.sort(values)[1:]
    distinct = values[np.append(True, np.diff(values) > _SAME * values[-1])]
    return Spectrum(float(values[0]), float(values[-1]), len(distinct), distinct)


def _by_formula(links: Links) -> Array:
    """Eigenvalues of a ring's or a square grid's Laplacian."""
    if links.kind == "ring":
        return np.asarray(2.0 - 2.0 * np.cos(2.0 * np.pi * np.arange(links.count) / links.count))
    side = math.isqrt(links.count)
    line = 2.0 - 2.0 * np.cos(np.pi * np.arange(side) / side)
    return np.add.outer(line, line).ravel()


def slowest_mode(links: Links) -> float:
    """Share of a disagreement that a round with Metropolis weights leaves at most."""
    matrix = links.metropolis()
    if links.count <= DENSE:
        values = np.linalg.eigvalsh(matrix.toarray())
        return float(max(values[-2], -values[0]))
    if links.kind == "random graph":
        largest = eigsh(matrix, k=2, which="LA", return_eigenvectors=False)
    else:  # they are close to each other: iterate with the inverse of what is close to singular
        largest = eigsh(matrix.tocsc(), k=2, sigma=1.0 + 1e-5, return_eigenvectors=False)
    smallest = eigsh(matrix, k=1, which="SA", return_eigenvectors=False, tol=1e-3)
    return float(max(np.sort(largest)[0], -smallest[0]))


def radius(links: Links) -> int:
    """Depth of the flattest breadth-first tree; of large random graphs that of the best of some roots."""
    if links.count <= DENSE:
        roots = np.arange(links.count)
    elif links.kind == "random graph":
        roots = np.random.default_rng(1).integers(links.count, size=_ROOTS)
    else:  # all nodes of a ring are alike, and a grid is seen best from its middle
        roots = np.array([links.count // 2 + math.isqrt(links.count) // 2])
    hops = np.asarray(shortest_path(links.adjacency, unweighted=True, indices=roots))
    return int(hops.max(axis=1).min())
