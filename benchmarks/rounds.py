"""Rounds, bytes and errors of the network's sums on graphs of up to 10,000 robots: algebra, no robots.

    python -m benchmarks.rounds [--effort short|usual|full]

For each graph: how many rounds each schedule takes, which is how many blocks late a sum is, and how many bytes an edge
carries per block and direction, with 20 samples of 18 numbers in a block. The pipeline's messages hold all blocks under
way, those of a tree one subtotal on its way up and one total on its way down, whatever the depth. Dynamic consensus is
never exact: its rounds are those to one percent of disagreement, on a load that stands still.
"""

from __future__ import annotations

import math

import numpy as np

from benchmarks.figures import Effort, Figure, Section
from benchmarks.graphs import DENSE, Links, Spectrum, grid, radius, random, ring, slowest_mode, spectrum
from benchmarks.runner import run_alone
from coheft.consensus.schedule import TOLERANCE, chebyshev, finite_time, tree
from coheft.errors import CoheftError
from coheft.estimation.geometry.spatial import Array

_BLOCK_BYTES = 20 * 18 * 8
_TREE_BLOCKS = 2
"""A subtotal up and a total down; robots at the ends of the tree say only one of them."""
_PERCENT = 0.01
_SIZES: dict[Effort, tuple[int, ...]] = {"short": (100,), "usual": (100, 1024, 10_000), "full": (25, 100, 1024, 10_000)}
_CHECKED = 100
"""Up to so many robots the schedules are also made by ``coheft.consensus.schedule``, which must come to the same."""


def measure(effort: Effort) -> Section:
    """Every schedule on every graph."""
    figures = [
        figure
        for count in _SIZES[effort]
        for links in (ring(count), grid(count), random(count))
        for figure in of_graph(links)
    ]
    return Section(name="rounds", title="Rounds and bytes per edge of the sums", figures=figures)


def of_graph(links: Links) -> list[Figure]:
    """All schedules on one graph.

    Raises:
        CoheftError: The product comes to other numbers of rounds.
    """
    found, depth = spectrum(links), radius(links)
    nodes = chebyshev_nodes(found, links.count)
    rounds = {
        "finite time": found.distinct,
        "Chebyshev": len(nodes),
        "tree": 2 * depth,
        "dynamic, to 1 %": math.ceil(math.log(_PERCENT) / math.log(slowest_mode(links))),
    }
    if links.count <= _CHECKED:
        _check(links, rounds)
    errors: dict[str, float] = {}
    if links.count <= DENSE and found.values is not None:
        errors = {"finite time": error(links, found.values), "Chebyshev": error(links, nodes)}
    return [
        Figure(
            name=f"{links.kind} of {links.count:,}, {name}",
            value=count,
            unit="rounds",
            note=_note(name, count, errors.get(name)),
        )
        for name, count in rounds.items()
    ]


def _note(name: str, rounds: int, left: float | None) -> str:
    if name == "tree":
        return f"at most {_TREE_BLOCKS * _BLOCK_BYTES / 1e3:.1f} kB per edge and block"
    told = f"{rounds * _BLOCK_BYTES / 1e3:,.0f} kB per edge and block"
    if left is None:
        return told
    return f"{told}; leaves {left:.0e}" + (": not usable" if left > TOLERANCE else "")


def _check(links: Links, rounds: dict[str, int]) -> None:
    neighbours = links.neighbours()
    made = {
        "finite time": finite_time(neighbours).rounds,
        "Chebyshev": chebyshev(neighbours, TOLERANCE).rounds,
        "tree": tree(neighbours).rounds,
    }
    for name, count in made.items():
        if count != rounds[name]:
            raise CoheftError(
                f"{name} on a {links.kind} of {links.count}: consensus.schedule makes {count} rounds, "
                f"but the algebra of this benchmark expects {rounds[name]}"
            )


def chebyshev_nodes(found: Spectrum, count: int) -> Array:
    """Roots of the Chebyshev polynomial that leaves as little as ``coheft.consensus.schedule`` allows."""
    middle, half = 0.5 * (found.high + found.low), 0.5 * (found.high - found.low)
    share = TOLERANCE / (2.0 * count)
    rounds = math.ceil(math.acosh(1.0 / share) / math.acosh(middle / half))
    return np.asarray(middle + half * np.cos(np.pi * (np.arange(rounds) + 0.5) / rounds))


def error(links: Links, nodes: Array) -> float:
    """What rounds with these nodes leave of a random disagreement, by rounding or by design."""
    values = np.random.default_rng(1).normal(size=links.count)
    largest, mean, matrix = float(np.abs(values).max()), float(values.mean()), links.laplacian()
    with np.errstate(over="ignore", invalid="ignore"):
        for node in leja_order(nodes):
            values = values - (matrix @ values) / node
        left = float(np.abs(values - mean).max()) / largest
    return left if math.isfinite(left) else math.inf


def leja_order(nodes: Array) -> Array:
    """Each next node has the largest product of distances to those before, as in ``coheft.consensus.schedule``."""
    order = np.empty(len(nodes), dtype=np.int64)
    distance = np.abs(nodes)
    taken = np.zeros(len(nodes), dtype=np.bool_)
    for k in range(len(nodes)):
        order[k] = np.argmax(np.where(taken, -np.inf, distance))
        taken[order[k]] = True
        gaps = np.log(np.abs(nodes - nodes[order[k]]) + 1e-300)
        distance = gaps if k == 0 else distance + gaps
    return nodes[order]


if __name__ == "__main__":
    run_alone("rounds", __doc__)
