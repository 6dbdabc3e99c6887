"""Dynamic consensus on every kind of graph: limit, conservation, decay, and what a loss does."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest

from coheft.consensus.graph import Neighbours, build_graph, metropolis_matrix
from coheft.estimation.geometry.spatial import Array
from coheft.wire.scenario.schema import Graph
from tests.consensus_network import CHANNELS, SAMPLES, Network

GRAPHS = {
    "pair": build_graph(Graph(kind="line"), ["a", "b"]),
    **{
        kind: build_graph(Graph(kind=kind, seed=3), [f"r{i}" for i in range(7)])  # type: ignore[arg-type]
        for kind in ("ring", "line", "star", "complete", "random")
    },
}

every_graph = pytest.mark.parametrize("graph", GRAPHS.values(), ids=GRAPHS.keys())


@every_graph
def test_limit_is_the_transported_average(graph: Neighbours) -> None:
    network = Network(graph, rounds=5, seed=1)
    inputs = network.random_inputs(np.random.default_rng(2))
    found: dict[str, Array | None] = {}
    for _ in range(600):
        found = network.step(inputs)
    average = network.in_common(lambda name: inputs[name]).mean(axis=0)
    for name, value in found.items():
        assert value is not None
        np.testing.assert_allclose(value @ network.to_common[name].T, average, atol=1e-10)


@every_graph
def test_sum_is_conserved_at_every_stage_while_inputs_move(graph: Neighbours) -> None:
    network = Network(graph, rounds=4, seed=2)
    rng = np.random.default_rng(3)
    totals: deque[Array] = deque(maxlen=4)
    for _ in range(40):
        inputs = network.random_inputs(rng)
        network.step(inputs)
        totals.appendleft(network.in_common(lambda name, inputs=inputs: inputs[name]).sum(axis=0))
        under_way = network.in_common(lambda name: network.dynamic[name].pipeline.stages).sum(axis=0)
        np.testing.assert_allclose(under_way[: len(totals)], totals, atol=1e-10)


@every_graph
@pytest.mark.parametrize("rounds", [1, 3])
def test_disagreement_decays_with_the_second_eigenvalue(graph: Neighbours, rounds: int) -> None:
    """Inputs along its eigenvector shrink by exactly the eigenvalue in every round."""
    network = Network(graph, rounds, seed=4)
    eigenvalues, eigenvectors = np.linalg.eigh(metropolis_matrix(graph))
    wrench = np.random.default_rng(5).normal(size=(SAMPLES, CHANNELS))
    inputs = {
        name: share * wrench @ np.linalg.inv(network.to_common[name]).T
        for name, share in zip(graph, eigenvectors[:, -2], strict=True)
    }
    passes = 6
    for block in range(rounds * (passes + 1)):
        found = network.step(inputs)
        factor = eigenvalues[-2] ** (rounds * (block // rounds))
        for name, value in found.items():
            if value is None:
                assert block < rounds
            else:
                np.testing.assert_allclose(value, factor * inputs[name], atol=1e-12)


@every_graph
def test_pipelined_is_proposition_3(graph: Neighbours) -> None:
    """Against the rule written down plainly: add the input's increment, then do all rounds at once."""
    rounds, blocks = 3, 30
    network = Network(graph, rounds, seed=6)
    rng = np.random.default_rng(7)
    history = [network.random_inputs(rng) for _ in range(blocks)]
    expected: list[dict[str, Array]] = []
    for block in range(blocks):
        x = history[block]
        if block >= rounds:
            x = {i: expected[block - rounds][i] + x[i] - history[block - rounds][i] for i in graph}
        for _ in range(rounds):
            x = {
                i: x[i] + sum(network.gain(i, j) * (x[j] @ network.transports[i, j].T - x[i]) for j in others)
                for i, others in graph.items()
            }
        expected.append(x)
    for block, inputs in enumerate(history):
        for name, value in network.step(inputs).items():
            if value is None:
                assert block < rounds
            else:
                np.testing.assert_allclose(value, expected[block - rounds][name], atol=1e-11)


@every_graph
def test_after_a_loss_nothing_wrong_is_used_and_all_notice(graph: Neighbours) -> None:
    rounds = 4
    whole, damaged = Network(graph, rounds, seed=8), Network(graph, rounds, seed=8)
    rng = np.random.default_rng(9)
    to = next(iter(graph))
    loss = {(to, graph[to][0])}
    found: dict[str, Array | None] = {}
    for block in range(80):
        inputs = whole.random_inputs(rng)
        expected, found = whole.step(inputs), damaged.step(inputs, loss if block == 20 else ())
        for name, value in found.items():
            if value is not None:
                np.testing.assert_equal(value, expected[name])
    assert all(value is None for value in found.values())
    assert all(agent.is_broken for agent in damaged.dynamic.values())
    assert not any(agent.is_broken for agent in whole.dynamic.values())
