"""Pipelined rounds: as if each block went through its rounds at once, and nothing incomplete ever leaves."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.consensus.graph import build_graph, distances
from coheft.consensus.pipeline import NeighbourStages, Pipeline
from coheft.estimation.geometry.spatial import Array
from coheft.wire.scenario.schema import Graph
from tests.consensus_network import CHANNELS, SAMPLES, Network

ROUNDS = 4
NAMES = ["a", "b", "c", "d", "e", "f"]


def run(network: Network, blocks: int, lost: dict[int, set[tuple[str, str]]]) -> dict[str, dict[int, Array | None]]:
    """What leaves each agent's pipeline, by the number of the block; block k enters at step k."""
    pipelines = {name: Pipeline(ROUNDS, SAMPLES, CHANNELS) for name in network.graph}
    rng = np.random.default_rng(1)
    left: dict[str, dict[int, Array | None]] = {name: {} for name in network.graph}
    for block in range(blocks):
        heard = network.heard(pipelines, lost.get(block, set()))
        inputs = network.random_inputs(rng)
        for name, pipeline in pipelines.items():
            left[name][block - ROUNDS] = pipeline.advance(heard[name], network.own_gains(name))
            pipeline.enter(inputs[name])
    return left


def test_a_pipeline_has_rounds_samples_and_channels() -> None:
    with pytest.raises(ValueError, match="0 rounds of 5 x 3 numbers, but each has to be at least 1"):
        Pipeline(0, 5, 3)


def test_nothing_leaves_before_the_first_block_has_done_its_rounds() -> None:
    left = run(Network(build_graph(Graph(kind="ring"), NAMES), ROUNDS), 12, {})
    for values in left.values():
        assert [block for block, value in values.items() if value is not None] == list(range(12 - ROUNDS))


@pytest.mark.parametrize("kind", ["ring", "line", "star", "complete"])
def test_a_lost_message_costs_exactly_the_blocks_that_need_it(kind: str) -> None:
    """At distance d from where it was missed, those that had more than d rounds to go; all other values are untouched.

    The message lost at step n holds blocks n - 1 (all its rounds to go) to n - K (one to go).
    """
    network = Network(build_graph(Graph(kind=kind), NAMES), ROUNDS)  # type: ignore[arg-type]
    step = 9
    whole, damaged = run(network, 20, {}), run(network, 20, {step: {("b", "a")}})
    hops = distances(network.graph, "b")
    for name in NAMES:
        missing = {block for block, value in damaged[name].items() if block >= 0 and value is None}
        assert missing == set(range(step - ROUNDS + hops[name], step))
        for block in set(damaged[name]) - missing:
            np.testing.assert_equal(damaged[name][block], whole[name][block])


@pytest.mark.parametrize(
    ("stages", "valid"),
    [((ROUNDS, SAMPLES), ROUNDS), ((ROUNDS, SAMPLES, 1), ROUNDS), ((ROUNDS, SAMPLES, CHANNELS), 1), ((), ROUNDS)],
)
def test_stages_of_another_shape_count_as_missing(stages: tuple[int, ...], valid: int) -> None:
    pipeline = Pipeline(ROUNDS, SAMPLES, CHANNELS)
    for _ in range(ROUNDS):
        pipeline.advance([], np.ones(ROUNDS))
        pipeline.enter(np.ones((SAMPLES, CHANNELS)))
    assert pipeline.valid.all()
    wrong = NeighbourStages(np.eye(CHANNELS), np.ones(ROUNDS), np.ones(stages), np.ones(valid, dtype=np.bool_))
    assert pipeline.advance([wrong], np.ones(ROUNDS)) is None
    assert not pipeline.valid[1:].any()


def test_a_block_that_one_agent_does_not_have_leaves_nowhere_it_was_needed() -> None:
    network = Network(build_graph(Graph(kind="line"), NAMES), ROUNDS)
    pipelines = {name: Pipeline(ROUNDS, SAMPLES, CHANNELS) for name in NAMES}
    values = np.ones((SAMPLES, CHANNELS))
    hops = distances(network.graph, "a")
    for block in range(2 * ROUNDS):
        heard = network.heard(pipelines)
        for name, pipeline in pipelines.items():
            finished = pipeline.advance(heard[name], network.own_gains(name))
            if block >= ROUNDS:
                is_hit = block - ROUNDS == 2 and hops[name] <= ROUNDS
                assert (finished is None) == is_hit
            pipeline.enter(None if block == 2 and name == "a" else values)
