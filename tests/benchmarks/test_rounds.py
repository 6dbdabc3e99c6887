"""The sparse algebra of large graphs comes to what the product does on small ones."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import graphs
from benchmarks.graphs import Links, grid, radius, random, ring, slowest_mode, spectrum
from benchmarks.rounds import error, leja_order, of_graph
from coheft.consensus.graph import Neighbours, diameter, laplacian, metropolis_matrix
from coheft.consensus.rounds import make_rounds
from coheft.consensus.schedule import Schedule, finite_time, tree
from coheft.estimation.geometry.spatial import Array

SAMPLES, WIDTH = 20, 18
GRAPHS = [ring(25), ring(36), grid(36), random(30)]


def largest_values(schedule: Schedule, neighbours: Neighbours) -> int:
    """Bytes of the values that an agent tells after a block, once all rounds are full: of the one that tells most."""
    agents = {name: make_rounds(schedule, "sums", name, others, SAMPLES, WIDTH) for name, others in neighbours.items()}
    told: dict[str, dict[str, Array]] = {name: {} for name in neighbours}
    for _ in range(schedule.rounds + 1):
        for agent in agents.values():
            agent.advance(told)
            agent.enter(np.ones((SAMPLES, WIDTH)))
        told = {name: agent.channels() for name, agent in agents.items()}
    return max(
        sum(array.nbytes for name, array in channels.items() if not name.endswith("versions"))
        for channels in told.values()
    )


@pytest.mark.parametrize("links", GRAPHS, ids=lambda links: f"{links.kind} {links.count}")
def test_matrices_are_those_of_the_product(links: Links) -> None:
    neighbours = links.neighbours()
    np.testing.assert_array_equal(links.laplacian().toarray(), laplacian(neighbours))
    np.testing.assert_allclose(links.metropolis().toarray(), metropolis_matrix(neighbours), atol=1e-14)
    assert radius(links) <= diameter(neighbours) <= 2 * radius(links)


@pytest.mark.parametrize("links", GRAPHS, ids=lambda links: f"{links.kind} {links.count}")
def test_rounds_are_those_of_the_product(links: Links) -> None:
    names = [figure.name.split(", ", 1)[1] for figure in of_graph(links)]  # raises if the product makes others
    assert names == ["finite time", "Chebyshev", "tree", "dynamic, to 1 %"]


@pytest.mark.parametrize("links", GRAPHS, ids=lambda links: f"{links.kind} {links.count}")
def test_bytes_are_those_of_the_product(links: Links) -> None:
    neighbours = links.neighbours()
    told = {figure.name.split(", ", 1)[1]: figure.note for figure in of_graph(links)}
    assert f" {largest_values(tree(neighbours), neighbours) / 1e3:.1f} kB" in told["tree"]
    assert told["finite time"].startswith(f"{largest_values(finite_time(neighbours), neighbours) / 1e3:,.0f} kB")


@pytest.mark.parametrize("make", [ring, grid, random])
def test_large_graphs_are_seen_like_small_ones(make: object, monkeypatch: pytest.MonkeyPatch) -> None:
    links = make(64)  # type: ignore[operator]
    all_values, mode, depth = spectrum(links), slowest_mode(links), radius(links)
    monkeypatch.setattr(graphs, "DENSE", 10)
    found = spectrum(links)
    assert found.low == pytest.approx(all_values.low, rel=1e-6)
    assert found.high == pytest.approx(all_values.high, rel=1e-6)
    assert found.distinct == all_values.distinct
    assert slowest_mode(links) == pytest.approx(mode, rel=1e-6)
    assert radius(links) == depth


def test_eigenvalues_leave_nothing() -> None:
    links = ring(40)
    values = spectrum(links).values
    assert values is not None
    assert sorted(leja_order(values)) == sorted(values)
    assert error(links, values) < 1e-12
    assert error(links, values[:-1]) > 1e-3
