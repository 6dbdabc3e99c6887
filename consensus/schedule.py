"""Schedules of rounds that give exact sums: the gains of each round, selected by cost.

All schedules are rounds ``x_i <- g_i x_i + sum_j g_ij x_j`` with gains that depend on the round:

- *finite time*: with ``lambda_1 ... lambda_K`` the distinct non-zero eigenvalues of the Laplacian, K rounds
  ``x <- x - L x / lambda_s`` give the exact average (Kibangou 2012). In Leja's order their product is well conditioned.
- *Chebyshev*: the same form with the roots of the Chebyshev polynomial on ``[lambda_2, lambda_N]`` in place of the
  eigenvalues: the fewest rounds that bring all disagreement below a tolerance.
- *tree*: sums flow up a breadth-first tree to its root, and the total flows down: twice the depth in rounds.

Every robot computes the same schedule from the graph that it learned by gossip. Large teams always use the tree: each
edge then carries only two values per block, however many rounds there are, and no robot computes eigenvalues.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from coheft.consensus.graph import LARGE_GRAPH, Neighbours, centre, check_graph, distances, laplacian
from coheft.estimation.geometry.spatial import Array

TOLERANCE = 1e-10
"""Largest disagreement that a schedule may leave, as a share of the inputs."""
_SAME_EIGENVALUE = 1e-7


@dataclass(frozen=True, eq=False)
class LaplacianSchedule:
    """Rounds ``x <- x - L x / root`` with the graph Laplacian ``L``.

    Attributes:
        kind: The method that gives the roots.
        neighbours: The graph.
        roots: One per round, shape (K,).
    """

    kind: Literal["finite time", "chebyshev"]
    neighbours: Neighbours
    roots: Array

    @property
    def rounds(self) -> int:
        """``K``, the number of rounds."""
        return len(self.roots)

    @property
    def scale(self) -> float:
        """Factor that turns the result, an average, into the sum of all inputs."""
        return float(len(self.neighbours))

    def gains(self, name: str, other: str) -> Array:
        """Return ``g_ij`` of each round, the gains of agent ``name`` for ``other`` (or itself), shape (K,)."""
        if name == other:
            return 1.0 - len(self.neighbours[name]) / self.roots
        return float(other in self.neighbours[name]) / self.roots

    def error(self) -> float:
        """Return the largest deviation of any agent's result from the sum of unit inputs, rounding errors included."""
        matrix = laplacian(self.neighbours)
        product = np.eye(len(matrix))
        for root in self.roots:
            product -= matrix @ product / root
        return float(np.abs(self.scale * product - 1.0).max())


@dataclass(frozen=True, eq=False)
class TreeSchedule:
    """Rounds up a breadth-first tree and down again.

    Attributes:
        parent: Parent of every name except the root.
        depth: Depth of every name, 0 for the root.
        height: The largest depth.
    """

    parent: Mapping[str, str]
    depth: Mapping[str, int]
    height: int
    kind: Literal["tree"] = "tree"
    scale: float = 1.0
    """Factor that turns the result into the sum of all inputs: it is that sum."""

    @property
    def rounds(self) -> int:
        """``K``, the number of rounds."""
        return 2 * self.height

    def gains(self, name: str, other: str) -> Array:
        """Return ``g_ij`` of each round, the gains of agent ``name`` for ``other`` (or itself), shape (K,)."""
        above = self.parent.get(name)
        gains = np.full(self.rounds, float(name == other))
        if above is not None and other in (name, above):
            gains[self.height + self.depth[name] - 1] = float(other == above)
        if self.parent.get(other) == name:
            gains[self.height - self.depth[other]] = 1.0
        return gains

    def error(self) -> float:
        """Return zero: a tree only adds."""
        return 0.0


Schedule = LaplacianSchedule | TreeSchedule


def choose_schedule(neighbours: Neighbours, tolerance: float = TOLERANCE) -> Schedule:
    """Return the schedule with the fewest rounds that is exact to the tolerance; for large teams the tree.

    Raises:
        GraphError: See ``check_graph``.
    """
    by_tree = tree(neighbours)
    if len(neighbours) == 1 or len(neighbours) > LARGE_GRAPH:
        return by_tree
    candidates = sorted(
        (finite_time(neighbours), by_tree, chebyshev(neighbours, tolerance)), key=lambda schedule: schedule.rounds
    )
    return next(schedule for schedule in candidates if schedule.error() <= tolerance)


def finite_time(neighbours: Neighbours) -> Schedule:
    """Return the schedule whose roots are the Laplacian's distinct non-zero eigenvalues, for two agents or more.

    Raises:
        GraphError: See ``check_graph``.
    """
    check_graph(neighbours)
    eigenvalues = np.linalg.eigvalsh(laplacian(neighbours))[1:]
    distinct = eigenvalues[np.append(True, np.diff(eigenvalues) > _SAME_EIGENVALUE * eigenvalues[-1])]
    return LaplacianSchedule("finite time", neighbours, _in_leja_order(distinct))


def chebyshev(neighbours: Neighbours, tolerance: float) -> Schedule:
    """Return the schedule whose roots are those of the Chebyshev polynomial that is within tolerance on the spectrum,
    for two agents or more.

    Raises:
        GraphError: See ``check_graph``.
    """
    check_graph(neighbours)
    eigenvalues = np.linalg.eigvalsh(laplacian(neighbours))
    low, high = eigenvalues[1], eigenvalues[-1]
    middle, half = 0.5 * (high + low), 0.5 * (high - low)
    if half <= _SAME_EIGENVALUE * high:
        return LaplacianSchedule("chebyshev", neighbours, np.array([middle]))
    share = tolerance / (2.0 * len(eigenvalues))
    rounds = int(np.ceil(np.arccosh(1.0 / share) / np.arccosh(middle / half)))
    roots = middle + half * np.cos(np.pi * (np.arange(rounds) + 0.5) / rounds)
    return LaplacianSchedule("chebyshev", neighbours, _in_leja_order(roots))


def tree(neighbours: Neighbours) -> TreeSchedule:
    """Return the schedule of a breadth-first tree whose root is the graph's centre.

    Raises:
        GraphError: See ``check_graph``.
    """
    check_graph(neighbours)
    root = centre(neighbours)
    depth = distances(neighbours, root)
    parent = {
        name: min(other for other in others if depth[other] == depth[name] - 1)
        for name, others in neighbours.items()
        if name != root
    }
    return TreeSchedule(parent, depth, max(depth.values()))


def _in_leja_order(points: Array) -> Array:
    """Return points in Leja's order: each next one maximizes the product of distances to those before it."""
    chosen = [float(points[np.argmax(np.abs(points))])]
    remaining = np.delete(points, np.argmax(np.abs(points)))
    while len(remaining):
        log_product = np.log(np.abs(np.subtract.outer(remaining, chosen)) + 1e-300).sum(axis=1)
        farthest = int(np.argmax(log_product))
        chosen.append(float(remaining[farthest]))
        remaining = np.delete(remaining, farthest)
    return np.array(chosen)
