"""Sums up a tree and down again: the same as any rounds with a tree's gains, with two values on an edge."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from coheft.consensus.graph import Neighbours, build_graph
from coheft.consensus.pipeline import NeighbourStages, Pipeline
from coheft.consensus.rounds import Rounds, make_rounds
from coheft.consensus.schedule import Schedule, TreeSchedule, finite_time, tree
from coheft.estimation.geometry.spatial import Array
from coheft.wire.scenario.schema import Graph
from tests.test_graph import names

SAMPLES, WIDTH = 3, 6
CHANNEL = "sums"
GRAPHS = {
    "pair": build_graph(Graph(kind="line"), names(2)),
    "line of 7": build_graph(Graph(kind="line"), names(7)),
    "star of 7": build_graph(Graph(kind="star"), names(7)),
    "tree of 15": build_graph(Graph(kind="tree", branches=2), names(15)),
    "grid of 12": build_graph(Graph(kind="grid"), names(12)),
    "random of 16": build_graph(Graph(kind="random", seed=3), names(16)),
    "ring of 70": build_graph(Graph(kind="ring"), names(70)),
}
every_graph = pytest.mark.parametrize("graph", GRAPHS.values(), ids=GRAPHS.keys())


class Team:
    """Agents that add up values (B, C)."""

    def __init__(self, graph: Neighbours, schedule: Schedule) -> None:
        self.graph, self.schedule = graph, schedule
        self.agents: dict[str, Rounds] = {
            name: make_rounds(schedule, CHANNEL, name, others, SAMPLES, WIDTH) for name, others in graph.items()
        }
        self.told: dict[str, dict[str, Array]] = {name: {} for name in graph}

    def block(
        self,
        inputs: Array,
        arrives: Callable[[str, str], bool] = lambda to, sender: True,
        version: Callable[[str], int] = lambda name: 0,
    ) -> dict[str, Array | None]:
        """Everyone puts in its values of ``inputs`` (N, B, C); returns what leaves."""
        left = {}
        before, self.told = self.told, {}
        for values, (name, agent) in zip(inputs, self.agents.items(), strict=True):
            left[name] = agent.advance({other: before[other] for other in self.graph[name] if arrives(name, other)})
            agent.enter(values, version(name))
            self.told[name] = agent.channels()
        return left


def random_inputs(graph: Neighbours, blocks: int) -> Array:
    return np.random.default_rng(4).normal(size=(blocks, len(graph), SAMPLES, WIDTH))


@every_graph
def test_the_sums_are_those_of_a_pipeline_with_the_gains_of_the_tree(graph: Neighbours) -> None:
    schedule = tree(graph)
    team = Team(graph, schedule)
    pipelines = {name: Pipeline(schedule.rounds, SAMPLES, WIDTH) for name in graph}
    own_gains = {name: schedule.gains(name, name) for name in graph}
    gains = {(name, other): schedule.gains(name, other) for name, others in graph.items() for other in others}
    for inputs in random_inputs(graph, schedule.rounds + 3):
        found = team.block(inputs)
        sent = {name: (pipeline.stages.copy(), pipeline.valid.copy()) for name, pipeline in pipelines.items()}
        for values, (name, pipeline) in zip(inputs, pipelines.items(), strict=True):
            heard = [NeighbourStages(None, gains[name, other], *sent[other]) for other in graph[name]]
            np.testing.assert_equal(found[name], pipeline.advance(heard, own_gains[name]))
            pipeline.enter(values)
    assert all(value is not None for value in found.values())


@every_graph
def test_an_edge_carries_two_values_at_most_however_many_rounds_there_are(graph: Neighbours) -> None:
    schedule = tree(graph)
    team = Team(graph, schedule)
    for inputs in random_inputs(graph, schedule.rounds + 2):
        team.block(inputs)
    for name, told in team.told.items():
        is_root = name not in schedule.parent
        has_children = name in schedule.parent.values()
        assert sum(array.size for array in told.values()) == SAMPLES * WIDTH * ((not is_root) + has_children) + 2


@every_graph
@pytest.mark.parametrize("make", [tree, finite_time])
def test_what_a_lost_message_spoils_never_leaves(graph: Neighbours, make: Callable[[Neighbours], Schedule]) -> None:
    schedule = make(graph)
    team = Team(graph, schedule)
    inputs = random_inputs(graph, 2 * schedule.rounds + 4)
    lost, hearer = schedule.rounds + 1, sorted(graph)[-1]
    complete = 0
    for block, values in enumerate(inputs):
        left = team.block(values, arrives=lambda to, _, block=block: (block, to) != (lost, hearer))  # type: ignore[misc]
        for total in left.values():
            if total is not None:
                complete += 1
                np.testing.assert_allclose(
                    schedule.scale * total, inputs[block - schedule.rounds].sum(axis=0), rtol=0.0, atol=1e-9
                )
    assert 0 < complete < len(graph) * (len(inputs) - schedule.rounds)


def test_a_tree_loses_one_block_by_a_lost_message_and_only_where_it_was_to_go() -> None:
    graph = GRAPHS["tree of 15"]
    schedule = tree(graph)
    assert isinstance(schedule, TreeSchedule)
    leaf = max(graph, key=lambda name: schedule.depth[name])
    above = schedule.parent[leaf]
    for to, sender, losers in ((leaf, above, {leaf}), (above, leaf, set(graph))):
        team = Team(graph, schedule)
        missing = []
        for block, values in enumerate(random_inputs(graph, 3 * schedule.rounds)):
            lost = (to, sender) if block == schedule.rounds else ()
            left = team.block(values, arrives=lambda *edge, lost=lost: edge != lost)
            if block >= schedule.rounds:
                missing += [(block, name) for name, total in left.items() if total is None]
        assert {name for _, name in missing} == losers
        assert len({block for block, _ in missing}) == 1


@every_graph
@pytest.mark.parametrize("make", [tree, finite_time])
def test_values_of_different_versions_are_never_added(
    graph: Neighbours, make: Callable[[Neighbours], Schedule]
) -> None:
    """One switches three blocks after the others: the totals of these blocks leave nowhere."""
    schedule = make(graph)
    team = Team(graph, schedule)
    late, switch = sorted(graph)[0], 2
    for block, values in enumerate(random_inputs(graph, schedule.rounds + 10)):
        left = team.block(values, version=lambda name, block=block: int(block >= switch + 3 * (name == late)))  # type: ignore[misc]
        number = block - schedule.rounds
        if number >= 0:
            is_mixed = switch <= number < switch + 3
            assert all((total is None) == is_mixed for total in left.values())


@every_graph
@pytest.mark.parametrize("make", [tree, finite_time])
def test_after_a_missed_block_everything_under_way_is_given_up(
    graph: Neighbours, make: Callable[[Neighbours], Schedule]
) -> None:
    """Whoever missed blocks has no part in any sum of before, and all later ones are right."""
    schedule = make(graph)
    team = Team(graph, schedule)
    missed, name = schedule.rounds + 2, sorted(graph)[len(graph) // 2]
    inputs = random_inputs(graph, 3 * schedule.rounds + 4)
    for block, values in enumerate(inputs):
        if block == missed:
            team.agents[name].clear()
        left = team.block(values)
        number = block - schedule.rounds
        if missed <= block < missed + schedule.rounds:
            assert left[name] is None
        for total in left.values():
            if total is not None:
                np.testing.assert_allclose(schedule.scale * total, inputs[number].sum(axis=0), rtol=0.0, atol=1e-9)
        if number >= missed:
            assert all(total is not None for total in left.values())


@pytest.mark.parametrize("make", [tree, finite_time])
def test_shapes_that_do_not_fit_are_told_and_ignored(make: Callable[[Neighbours], Schedule]) -> None:
    graph = GRAPHS["star of 7"]
    agent = make_rounds(make(graph), CHANNEL, "r00", graph["r00"], SAMPLES, WIDTH)
    agent.enter(np.ones((SAMPLES, WIDTH)))
    for name, array in agent.channels().items():
        wrong = {name: np.ones((*array.shape, 1))}
        assert agent.fit({name: array})
        assert not agent.fit(wrong)
        assert agent.advance(dict.fromkeys(graph["r00"], wrong)) is None
    assert agent.fit({})
