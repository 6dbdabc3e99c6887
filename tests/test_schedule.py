"""Exact sums by one-hop messages: every kind of schedule, on every kind of graph, from everyone's point of view."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
import pytest

from coheft.consensus.graph import Neighbours, build_graph, distances
from coheft.consensus.pipeline import NeighbourStages, Pipeline
from coheft.consensus.schedule import TOLERANCE, Schedule, chebyshev, choose_schedule, finite_time, tree
from coheft.estimation.geometry.body_motion import perturbed
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.wire.scenario.schema import Graph
from tests.estimation.team import random_pose
from tests.test_graph import names

SAMPLES, CHANNELS = 3, 6
GRAPHS = {
    "pair": build_graph(Graph(kind="line"), names(2)),
    "ring of 6": build_graph(Graph(kind="ring"), names(6)),
    "ring of 24": build_graph(Graph(kind="ring"), names(24)),
    "line of 12": build_graph(Graph(kind="line"), names(12)),
    "star of 7": build_graph(Graph(kind="star"), names(7)),
    "complete of 5": build_graph(Graph(kind="complete"), names(5)),
    "random of 16": build_graph(Graph(kind="random", seed=3), names(16)),
}
every_graph = pytest.mark.parametrize("graph", GRAPHS.values(), ids=GRAPHS.keys())


def totals(
    graph: Neighbours, schedule: Schedule, inputs: Array, lost: Collection[tuple[int, str, str]] = ()
) -> dict[str, list[Array | None]]:
    """What leaves each agent's pipeline of inputs (blocks, N, B, C), times the scale, by the number of the block.

    Messages ``(block, to, sender)`` in ``lost`` do not arrive.
    """
    pipelines = {name: Pipeline(schedule.rounds, SAMPLES, CHANNELS) for name in graph}
    left: dict[str, list[Array | None]] = {name: [] for name in graph}
    for block in range(len(inputs) + schedule.rounds):
        sent = {name: (pipeline.stages.copy(), pipeline.valid.copy()) for name, pipeline in pipelines.items()}
        for k, (name, pipeline) in enumerate(pipelines.items()):
            heard = [
                NeighbourStages(None, schedule.gains(name, j), *((None, None) if (block, name, j) in lost else sent[j]))
                for j in graph[name]
            ]
            finished = pipeline.advance(heard, schedule.gains(name, name))
            if block >= schedule.rounds:
                left[name].append(None if finished is None else schedule.scale * finished)
            pipeline.enter(inputs[block, k] if block < len(inputs) else None)
    return left


def wrenches(graph: Neighbours, blocks: int = 1) -> Array:
    """Measured wrenches, each in its own frame, shape (blocks, N, B, 6)."""
    return np.random.default_rng(1).normal(scale=20.0, size=(blocks, len(graph), SAMPLES, CHANNELS))


def total_wrenches(graph: Neighbours, poses: Sequence[Pose], measured: Array) -> list[Array]:
    """Every agent's total (B, 6), in its own frame."""
    carried = np.stack([measured[:, k] @ pose.adjoint().T for k, pose in enumerate(poses)], axis=1)
    left = totals(graph, choose_schedule(graph), carried)
    results = []
    for pose, (total,) in zip(poses, left.values(), strict=True):
        assert total is not None
        results.append(total @ pose.inverse().adjoint().T)
    return results


def assert_close(found: Array | None, expected: Array) -> None:
    assert found is not None
    assert np.linalg.norm(found - expected) < 1e-9 * np.linalg.norm(expected)


@every_graph
@pytest.mark.parametrize("make", [finite_time, lambda graph: chebyshev(graph, TOLERANCE), tree, choose_schedule])
def test_every_schedule_gives_everybody_the_exact_sum(graph: Neighbours, make: type) -> None:
    schedule = make(graph)
    if not schedule.error() < TOLERANCE:
        # Too many rounds of the Laplacian lose their digits: this must be known, and the schedule not be chosen.
        assert schedule.kind != choose_schedule(graph).kind
        return
    inputs = wrenches(graph, blocks=3)
    for left in totals(graph, schedule, inputs).values():
        for found, values in zip(left, inputs, strict=True):
            assert_close(found, values.sum(axis=0))


@every_graph
def test_the_chosen_schedule_has_the_fewest_rounds(graph: Neighbours) -> None:
    chosen = choose_schedule(graph)
    reach = max(max(distances(graph, name).values()) for name in graph)
    exact = [s for s in (finite_time(graph), chebyshev(graph, TOLERANCE), tree(graph)) if s.error() < TOLERANCE]
    assert reach <= chosen.rounds == min(schedule.rounds for schedule in exact)


@pytest.mark.parametrize(
    ("name", "kind", "rounds"),
    [
        ("pair", "finite time", 1),
        ("complete of 5", "finite time", 1),
        ("star of 7", "finite time", 2),
        ("ring of 6", "finite time", 3),
        ("ring of 24", "finite time", 12),
        ("line of 12", "finite time", 11),
        ("random of 16", "tree", 6),
    ],
)
def test_which_is_chosen(name: str, kind: str, rounds: int) -> None:
    schedule = choose_schedule(GRAPHS[name])
    assert (schedule.kind, schedule.rounds) == (kind, rounds)


def test_a_coarse_tolerance_saves_rounds() -> None:
    line = build_graph(Graph(kind="line"), names(12))
    rounds = [chebyshev(line, tolerance).rounds for tolerance in (1e-2, 1e-4, 1e-8)]
    assert rounds == sorted(set(rounds))
    for tolerance in (1e-2, 1e-4, 1e-8):
        assert chebyshev(line, tolerance).error() < tolerance


@every_graph
def test_the_total_wrench_is_the_sum_of_the_measured_ones_seen_from_each_robot(graph: Neighbours) -> None:
    rng = np.random.default_rng(2)
    poses = [random_pose(rng) for _ in graph]
    measured = wrenches(graph)
    for own, total in zip(poses, total_wrenches(graph, poses, measured), strict=True):
        seen = [measured[0, k] @ (own.inverse() @ pose).adjoint().T for k, pose in enumerate(poses)]
        assert_close(total, np.sum(seen, axis=0))


@every_graph
def test_with_estimated_poses_everybody_sees_the_same_total_from_its_own_frame(graph: Neighbours) -> None:
    rng = np.random.default_rng(3)
    true = [random_pose(rng) for _ in graph]
    poses = [perturbed(pose, 0.05 * rng.normal(size=6)) for pose in true]
    measured = wrenches(graph)
    found = total_wrenches(graph, poses, measured)
    for pose, total in zip(poses, found, strict=True):
        assert_close(total @ pose.adjoint().T, found[0] @ poses[0].adjoint().T)
    exact = total_wrenches(graph, true, measured)
    assert np.linalg.norm(found[0] - exact[0]) > 1e-3 * np.linalg.norm(exact[0])


@every_graph
def test_a_lost_message_costs_exactly_the_blocks_that_hang_on_it(graph: Neighbours) -> None:
    """At distance d from where it is missed, those that had more than d rounds to go; all others stay exact."""
    schedule = choose_schedule(graph)
    rounds, step = schedule.rounds, schedule.rounds + 2
    inputs = wrenches(graph, blocks=rounds + 5)
    hearer = sorted(graph)[1]
    left = totals(graph, schedule, inputs, lost={(step, hearer, graph[hearer][0])})
    for name, hops in distances(graph, hearer).items():
        missing = {block for block, total in enumerate(left[name]) if total is None}
        assert missing == set(range(step - rounds + hops, step))
        for block, total in enumerate(left[name]):
            if total is not None:
                assert_close(total, inputs[block].sum(axis=0))
