"""Exact sums in a finite number of rounds: which gains to use in which round, chosen by cost.

All schedules are rounds ``x_i <- g_i x_i + sum_j g_ij x_j`` with gains that depend on the round:

- *finite time*: with ``lambda_1 ... lambda_K`` the distinct non-zero eigenvalues of the Laplacian, K rounds
  ``x <- x - L x / lambda_s`` give the exact average (Kibangou 2012). In Leja's order their product is well conditioned.
- *Chebyshev*: the same form with the roots of the Chebyshev polynomial on ``[lambda_2, lambda_N]`` in place of the
  eigenvalues: the fewest rounds that bring all disagreement below a tolerance.
- *tree*: sums flow up a breadth-first tree to its root, and the total flows down: twice the depth in rounds.

Everybody computes the same schedule from the graph that gossip has told.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from coheft.estimation.spatial import Array
from consensus.graph import Neighbours, distances, laplacian

TOLERANCE = 1e-10
"""Largest share of the inputs that a schedule may leave as disagreement."""
_SAME_EIGENVALUE = 1e-7


@dataclass(frozen=True, eq=False)
class Schedule:
    """Gains of every agent in every round; ``scale`` times the result is the sum of all inputs.

    Attributes:
        kind: How it was made.
        matrices: One round each, shape (K, N, N), in the order of ``names``.
        names: Of the agents.
        scale: What to multiply the result with, to have the sum.
    """

    kind: Literal["finite time", "chebyshev", "tree"]
    matrices: Array
    names: tuple[str, ...]
    scale: float

    @property
    def rounds(self) -> int:
        """``K``."""
        return len(self.matrices)

    def gains(self, name: str, other: str) -> Array:
        """``g_ij`` of each round, of agent ``name`` for ``other`` (or itself), shape (K,)."""
        return self.matrices[:, self.names.index(name), self.names.index(other)]

    def error(self) -> float:
        """Largest deviation of any agent's result from the sum of unit inputs; also from rounding on the way."""
        product = np.eye(len(self.names))
        for matrix in self.matrices:
            product = matrix @ product
        return float(np.abs(self.scale * product - 1.0).max())


def choose_schedule(neighbours: Neighbours, tolerance: float = TOLERANCE) -> Schedule:
    """The schedule with the fewest rounds among those that are exact to the tolerance on this graph."""
    candidates = [finite_time(neighbours), tree(neighbours), chebyshev(neighbours, tolerance)]
    return min((s for s in candidates if s.error() <= tolerance), key=lambda schedule: schedule.rounds)


def finite_time(neighbours: Neighbours) -> Schedule:
    """Rounds with the Laplacian's eigenvalues."""
    eigenvalues = np.linalg.eigvalsh(laplacian(neighbours))[1:]
    distinct = eigenvalues[np.append(True, np.diff(eigenvalues) > _SAME_EIGENVALUE * eigenvalues[-1])]
    return _laplacian_rounds("finite time", neighbours, distinct)


def chebyshev(neighbours: Neighbours, tolerance: float) -> Schedule:
    """Rounds with the roots of the Chebyshev polynomial that is just small enough on the spectrum."""
    eigenvalues = np.linalg.eigvalsh(laplacian(neighbours))
    low, high = eigenvalues[1], eigenvalues[-1]
    middle, half = 0.5 * (high + low), 0.5 * (high - low)
    if half <= _SAME_EIGENVALUE * high:
        return _laplacian_rounds("chebyshev", neighbours, np.array([middle]))
    share = tolerance / (2.0 * len(eigenvalues))
    rounds = int(np.ceil(np.arccosh(1.0 / share) / np.arccosh(middle / half)))
    roots = middle + half * np.cos(np.pi * (np.arange(rounds) + 0.5) / rounds)
    return _laplacian_rounds("chebyshev", neighbours, roots)


def tree(neighbours: Neighbours) -> Schedule:
    """Up a breadth-first tree and down again; its root is the name from which the farthest is nearest."""
    names = tuple(neighbours)
    root = min(names, key=lambda name: (max(distances(neighbours, name).values()), name))
    depth = distances(neighbours, root)
    parent = {name: min(o for o in neighbours[name] if depth[o] == depth[name] - 1) for name in names if name != root}
    height = max(depth.values())
    index = {name: i for i, name in enumerate(names)}
    matrices = np.tile(np.eye(len(names)), (2 * height, 1, 1))
    for name, above in parent.items():
        i, j = index[name], index[above]
        matrices[height - depth[name], j, i] = 1.0
        matrices[height + depth[name] - 1, i, i] = 0.0
        matrices[height + depth[name] - 1, i, j] = 1.0
    return Schedule("tree", matrices, names, 1.0)


def _laplacian_rounds(kind: Literal["finite time", "chebyshev"], neighbours: Neighbours, roots: Array) -> Schedule:
    matrix = laplacian(neighbours)
    matrices = np.array([np.eye(len(matrix)) - matrix / root for root in _in_leja_order(roots)])
    return Schedule(kind, matrices, tuple(neighbours), float(len(matrix)))


def _in_leja_order(points: Array) -> Iterator[float]:
    """Each next point has the largest product of distances to those before: partial products stay small."""
    remaining = list(points)
    chosen = [remaining.pop(int(np.argmax(np.abs(remaining))))]
    while remaining:
        distance = [np.log(np.abs(np.subtract(point, chosen)) + 1e-300).sum() for point in remaining]
        chosen.append(remaining.pop(int(np.argmax(distance))))
    return iter(chosen)
