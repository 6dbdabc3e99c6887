"""What docs/consensus.md promises: what is conserved, how fast it converges, and that no frame matters."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coheft.consensus import (
    DynamicConsensus,
    Extrapolation,
    Neighbours,
    NeighbourStages,
    Schedule,
    chebyshev,
    choose_schedule,
    convergence_rate,
    finite_time,
    lag_bound,
    make_rounds,
    metropolis_matrix,
    tree,
)
from coheft.estimation.geometry.spatial import Array
from tests.consensus_network import CHANNELS, SAMPLES, Network
from tests.test_dynamic import GRAPHS, every_graph
from tests.test_graph import graphs

seeds = st.integers(0, 10**6)


def in_common(network: Network, found: dict[str, Array | None]) -> Array:
    """What has left all agents in the common frame, shape (N, B, C)."""

    def value(name: str) -> Array:
        left = found[name]
        assert left is not None
        return left

    return network.in_common(value)


def inputs_seen(network: Network, values: Array) -> dict[str, Array]:
    """Inputs (N, B, C) in the common frame, as the agents see them."""
    return {
        name: each @ np.linalg.inv(network.to_common[name]).T for name, each in zip(network.graph, values, strict=True)
    }


@given(graphs, st.integers(1, 4), seeds)
def test_what_leaves_adds_up_to_what_entered(graph: Neighbours, rounds: int, seed: int) -> None:
    network, rng = Network(graph, rounds, seed), np.random.default_rng(seed)
    entered = [network.random_inputs(rng) for _ in range(3 * rounds)]
    for block, inputs in enumerate(entered):
        found = network.step(inputs)
        if block >= rounds:
            before = entered[block - rounds]
            total = network.in_common(lambda name, before=before: before[name]).sum(axis=0)
            np.testing.assert_allclose(in_common(network, found).sum(axis=0), total, atol=1e-10)


@given(graphs, st.integers(1, 4), seeds)
def test_no_frame_matters(graph: Neighbours, rounds: int, seed: int) -> None:
    values = np.random.default_rng(seed).normal(size=(2 * rounds + 1, len(graph), SAMPLES, CHANNELS))
    results = []
    for frames in (seed, seed + 1):
        network = Network(graph, rounds, frames)
        for each in values:
            found = network.step(inputs_seen(network, each))
        results.append(in_common(network, found))
    np.testing.assert_allclose(results[0], results[1], atol=1e-9)


@given(graphs, seeds)
def test_neither_the_order_of_agents_nor_of_messages_matters(graph: Neighbours, seed: int) -> None:
    """Names are shuffled with the inputs that go with them; messages come in the opposite order."""
    rng = np.random.default_rng(seed)
    order = [list(graph)[k] for k in rng.permutation(len(graph))]
    values = dict(zip(graph, rng.normal(size=(len(graph), 7, 1, 2)), strict=True))

    def run(shuffled: Neighbours) -> dict[str, Array]:
        agents = {name: DynamicConsensus(2, 1, 2) for name in shuffled}
        left: dict[str, Array] = {}
        for block in range(7):
            sent = {name: agent.pipeline.sent() for name, agent in agents.items()}
            for name, agent in agents.items():
                heard = [NeighbourStages(None, np.full(2, 1.0 / len(graph)), *sent[j]) for j in shuffled[name]]
                result = agent.step(values[name][block], heard)
                if result is not None:
                    left[name] = result
        return left

    plain, other = run(graph), run({name: graph[name][::-1] for name in order})
    for name in graph:
        np.testing.assert_allclose(plain[name], other[name], atol=1e-12)


@given(graphs, st.integers(1, 6), seeds)
def test_moving_inputs_stay_within_the_bound(graph: Neighbours, rounds: int, seed: int) -> None:
    network, rng = Network(graph, rounds, seed), np.random.default_rng(seed)
    rate = convergence_rate(metropolis_matrix(graph))
    start = rng.normal(size=(len(graph), SAMPLES, CHANNELS))
    steps = rng.uniform(-1.0, 1.0, size=(12 * rounds, *start.shape))
    truths = start + np.cumsum(steps, axis=0)
    moved = truths[rounds:] - truths[:-rounds]
    moved -= moved.mean(axis=1, keepdims=True)
    bound = lag_bound(rate, rounds, float(np.linalg.norm(moved, axis=1).max()))
    started = float(np.linalg.norm(truths[:rounds] - truths[:rounds].mean(axis=1, keepdims=True), axis=1).max())
    for block, truth in enumerate(truths):
        found = network.step(inputs_seen(network, truth))
        if block >= rounds:
            entered = truths[block - rounds]
            off = np.linalg.norm(in_common(network, found) - entered.mean(axis=0), axis=0).max()
            assert off <= bound + rate ** (rounds * (block // rounds)) * started + 1e-9


@every_graph
def test_the_bound_is_reached_by_a_ramp_along_the_slowest_part(graph: Neighbours) -> None:
    rounds = 2
    network = Network(graph, rounds, seed=3)
    eigenvalues, vectors = np.linalg.eigh(metropolis_matrix(graph))
    slowest = int(np.argsort(np.abs(eigenvalues))[-2])
    rate = convergence_rate(metropolis_matrix(graph))
    assert rate == pytest.approx(abs(eigenvalues[slowest]))
    ramp = vectors[:, slowest, None, None] * np.ones((SAMPLES, CHANNELS))
    for block in range(40 * rounds + int(30.0 / -np.log(max(rate, 1e-3)))):
        found = network.step(inputs_seen(network, block * ramp))
    off = np.linalg.norm(in_common(network, found), axis=0).max()
    assert off == pytest.approx(lag_bound(rate, rounds, float(rounds)), rel=1e-6, abs=1e-9)


@every_graph
@pytest.mark.parametrize("rounds", [1, 2, 4, 12, 24])
def test_extrapolation_leaves_as_much_as_it_says_and_never_more_than_there_was(graph: Neighbours, rounds: int) -> None:
    matrix, rng = metropolis_matrix(graph), np.random.default_rng(rounds)
    started = rng.normal(size=(len(graph), 2000))
    started -= started.mean(axis=0)
    before, after = (np.linalg.matrix_power(matrix, k) @ started for k in (rounds - 1, rounds))
    extrapolation = Extrapolation.of(matrix, rounds)
    left, change = np.linalg.norm(extrapolation.settled(after, before)), np.linalg.norm(after - before)
    assert left <= 1.02 * np.linalg.norm(after) + 1e-12
    assert left == pytest.approx(extrapolation.left * change, rel=0.1, abs=1e-12)
    assert left == pytest.approx(extrapolation.share * np.linalg.norm(after), rel=0.1, abs=1e-12)
    factors = extrapolation.factor * np.array([0.9, 1.1])
    assert all(left <= 1.01 * np.linalg.norm(after + each * (after - before)) + 1e-12 for each in factors)


@pytest.mark.parametrize("kind", GRAPHS)
@pytest.mark.parametrize("make", [choose_schedule, finite_time, tree, lambda graph: chebyshev(graph, 1e-10)])
def test_sums_in_frames_of_their_own_are_exact(kind: str, make) -> None:  # type: ignore[no-untyped-def]
    graph = GRAPHS[kind]
    schedule: Schedule = make(graph)
    network = Network(graph, 1, seed=4)
    agents = {
        name: make_rounds(
            schedule, "sums", name, others, SAMPLES, CHANNELS, {j: network.transports[name, j] for j in others}
        )
        for name, others in graph.items()
    }
    rng = np.random.default_rng(5)
    entered = [network.random_inputs(rng) for _ in range(schedule.rounds + 3)]
    sent: dict[str, dict[str, Array]] = {name: {} for name in graph}
    for block, inputs in enumerate(entered):
        before, sent, found = sent, {}, {}
        for name, agent in agents.items():
            found[name] = agent.advance({j: before[j] for j in graph[name]})
            agent.enter(inputs[name], version=block)
            sent[name] = agent.channels()
        if block >= schedule.rounds:
            put_in = entered[block - schedule.rounds]
            total = network.in_common(lambda name, put_in=put_in: put_in[name]).sum(axis=0)
            np.testing.assert_allclose(schedule.scale * in_common(network, found), [total] * len(graph), atol=1e-8)


@pytest.mark.parametrize("weight", [0.25, 0.5, 0.75, 1.0])
def test_the_rate_is_the_largest_in_magnitude(weight: float) -> None:
    """Of two agents: with a weight above one half, each overshoots the other, and the eigenvalue is negative."""
    matrix = np.array([[1.0 - weight, weight], [weight, 1.0 - weight]])
    assert convergence_rate(matrix) == pytest.approx(abs(1.0 - 2.0 * weight))
