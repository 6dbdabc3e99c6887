"""All robots count exactly the same blocks, whatever each of them has, and whatever gets lost on the way."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from agents.common_moments import CommonMoments
from agents.inbox import NeighbourInbox
from coheft.estimation.registration import FEATURES, RegistrationMoments
from coheft.wire.messages import NeighbourMessage
from coheft.wire.scenario import Graph
from consensus.graph import Neighbours, build_graph, diameter
from tests.test_graph import names

START = 1000
PARTS = 2
small_graphs = st.builds(
    lambda kind, n, seed: build_graph(Graph(kind=kind, seed=seed), names(n)),
    st.sampled_from(["ring", "line", "star", "complete", "random"]),
    st.integers(2, 7),
    st.integers(0, 10**6),
)


def moments_of(step: int, part: int) -> RegistrationMoments:
    """Moments by which this block can be told among all others in a sum."""
    gram = np.zeros((FEATURES, FEATURES))
    gram.ravel()[(step - START) * PARTS + part] = 1.0
    return RegistrationMoments(gram)


def blocks_in(moments: RegistrationMoments) -> set[tuple[int, int]]:
    """Steps and parts; each of them counts once."""
    counts = moments.gram.ravel()
    assert set(counts) <= {0.0, 1.0}
    return {(START + k // PARTS, k % PARTS) for k in np.flatnonzero(counts).tolist()}


class Team:
    """Robots that add up what they have.

    Attributes:
        had: Blocks that all of them have had.
        totals: What each robot had counted after so many chunks.
    """

    def __init__(self, graph: Neighbours, chunk: int) -> None:
        self.graph = graph
        self.robots = {
            name: CommonMoments(len(graph), own, START, chunk, PARTS, unsure=2)
            for own, name in enumerate(sorted(graph))
        }
        self.had: set[tuple[int, int]] = set()
        self.totals: dict[str, list[set[tuple[int, int]]]] = {name: [] for name in graph}
        self._sent = {name: (robot.flood.digest, robot.flood.told()) for name, robot in self.robots.items()}

    def step(self, step: int, rng: np.random.Generator, loss: float, missing: float) -> None:
        """One step: messages of the step before come, or do not; a robot has a block, or misses it."""
        everybody = {(step, part) for part in range(PARTS)}
        for name, robot in self.robots.items():
            for other in self.graph[name]:
                if rng.random() >= loss:
                    robot.flood.hear(other, *self._sent[other])
            while robot.agree(step - 1):
                self.totals[name].append(blocks_in(robot.total))
            has = [rng.random() >= missing for _ in range(PARTS)]
            robot.add(step, [moments_of(step, part) if has[part] else None for part in range(PARTS)])
            everybody -= {(step, part) for part in range(PARTS) if not has[part]}
        self.had |= everybody
        self._sent = {name: (robot.flood.digest, robot.flood.told()) for name, robot in self.robots.items()}

    def assert_alike(self) -> None:
        """Whoever has agreed upon as many chunks has counted the same blocks, and only what all have had."""
        longest = max(self.totals.values(), key=len)
        for totals in self.totals.values():
            assert totals == longest[: len(totals)]
        for before, after in pairwise(longest):
            assert before <= after
        assert not longest or longest[-1] <= self.had


chunks = st.integers(1, 9)
seeds = st.integers(0, 10**6)


@given(small_graphs, chunks, st.floats(0.0, 0.95), st.floats(0.0, 0.5), seeds)
def test_all_count_the_same_under_any_losses(
    graph: Neighbours, chunk: int, loss: float, missing: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    team = Team(graph, chunk)
    for step in range(START, START + 60):
        team.step(step, rng, loss, missing)
    # Without losses everybody goes on from there, and nobody stays behind.
    before = max(map(len, team.totals.values()))
    for step in range(START + 60, START + 60 + 4 * (diameter(graph) + chunk + 2)):
        team.step(step, rng, 0.0, 0.0)
    team.assert_alike()
    assert min(map(len, team.totals.values())) >= before + 2


@given(small_graphs, st.floats(0.0, 0.5), seeds)
def test_without_losses_all_that_everybody_has_counts(graph: Neighbours, missing: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    chunk = diameter(graph) + 2
    team = Team(graph, chunk)
    for step in range(START, START + 50):
        team.step(step, rng, 0.0, missing)
    for name, robot in team.robots.items():
        assert team.totals[name][-1] == {block for block in team.had if block[0] < START + robot.steps}
        assert robot.steps >= 50 - 3 * chunk


@given(small_graphs)
def test_after_a_long_silence_the_newest_samples_count_soon(graph: Neighbours) -> None:
    rng = np.random.default_rng(0)
    chunk = diameter(graph) + 2
    team = Team(graph, chunk)
    for step in range(START, START + 150):
        team.step(step, rng, 1.0, 0.0)
    for step in range(START + 150, START + 150 + 3 * (diameter(graph) + chunk + 2)):
        team.step(step, rng, 0.0, 0.0)
    team.assert_alike()
    for totals in team.totals.values():
        assert max(block[0] for block in totals[-1]) >= START + 150


def test_chunks_may_be_longer_than_a_number_has_bits() -> None:
    graph = build_graph(Graph(kind="line"), names(3))
    rng = np.random.default_rng(1)
    team = Team(graph, 70)
    for step in range(START, START + 300):
        team.step(step, rng, 0.1, 0.1)
    team.assert_alike()
    for name, robot in team.robots.items():
        assert robot.steps >= 140
        assert team.totals[name][-1] == {block for block in team.had if block[0] < START + robot.steps}


def test_neighbours_take_what_is_said_of_long_chunks() -> None:
    long = CommonMoments(1, 0, START, 70, PARTS, unsure=2)
    for step in range(START, START + 70):
        long.add(step, [moments_of(START, 0)] * PARTS)
        long.agree(step)
    message = NeighbourMessage(sender="r1", block=1, gossip=[], channels={"common": long.flood.table})
    used, _, problems = NeighbourInbox(["r1"]).take(2, [message])
    assert used
    assert not problems


def test_a_map_is_of_all_that_counts_and_of_what_will() -> None:
    rng = np.random.default_rng(2)
    feature_map = rng.normal(size=(FEATURES, FEATURES))
    blocks = [RegistrationMoments.of(rng.normal(size=(5, 9)), rng.normal(size=(5, 12))) for _ in range(3)]
    alone = CommonMoments(1, 0, START, 1, 1, unsure=2)
    alone.add(START, [blocks[0]])
    alone.add(START + 1, [blocks[1]])
    assert alone.agree(START)
    alone.map(feature_map)
    assert alone.agree(START + 1)
    alone.add(START + 2, [blocks[2].mapped(feature_map)])
    assert alone.agree(START + 2)
    expected = sum((moments.mapped(feature_map).gram for moments in blocks), np.zeros((FEATURES, FEATURES)))
    np.testing.assert_allclose(alone.total.gram, expected, rtol=1e-12)


def test_what_may_be_spoilt_counts_for_nobody() -> None:
    graph = build_graph(Graph(kind="line"), names(3))
    rng, chunk = np.random.default_rng(3), 5
    team = Team(graph, chunk)
    spoilt_at = START + 43
    for step in range(START, START + 100):
        team.step(step, rng, 0.1, 0.0)
        if step == spoilt_at:
            team.robots[sorted(graph)[1]].spoil(step)
    longest = max(team.totals.values(), key=len)
    for totals in team.totals.values():
        assert totals == longest[: len(totals)]
    steps = {step for step, _ in longest[-1]}
    # That chunk, and the two before, in which nobody had noticed yet; what was sure before, and what came after, stays.
    missing = [step for step in range(START, max(steps)) if step not in steps]
    assert spoilt_at in missing
    assert 2 * chunk < len(missing)
    assert min(steps) < START + 20
    assert max(steps) > spoilt_at + 2 * chunk
    assert {step for step in steps if missing[0] < step < missing[-1]} == set()


def test_what_is_told_of_a_long_chunk_is_no_nonsense_to_neighbours() -> None:
    """Teams that are far apart have long chunks: of 24 robots on a ring, 52 blocks."""
    robot = CommonMoments(robots=2, own=0, start=START, chunk=40, parts=PARTS, unsure=1)
    robot.flood.hear("r1", 1.0, None)
    for step in range(START, START + 40):
        robot.add(step, [moments_of(step, part) for part in range(PARTS)])
        robot.agree(step)
    rows = robot.flood.told()
    assert rows is not None
    assert rows.max() > 2**30
    message = NeighbourMessage(sender="r0", block=0, gossip=[], channels={"common": rows})
    used, _, problems = NeighbourInbox(["r0"]).take(1, [message])
    assert not problems
    assert list(used) == ["r0"]


@given(small_graphs, chunks, st.floats(0.0, 0.7), seeds)
def test_what_comes_again_does_not_count_twice_whoever_hears_of_it_when(
    graph: Neighbours, chunk: int, loss: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    team, again = Team(graph, chunk), START + 25
    hears = {name: again + (int(rng.integers(0, 20)) if k else 0) for k, name in enumerate(team.robots)}
    for step in range(START, START + 60):
        for name, robot in team.robots.items():
            if hears[name] == step:
                robot.begin_again(again)
        team.step(step, rng, loss, 0.1)
    for step in range(START + 60, START + 60 + 4 * (diameter(graph) + chunk + 2)):
        team.step(step, rng, 0.0, 0.0)
    longest = max(team.totals.values(), key=len)
    for totals in team.totals.values():
        assert totals == longest[: len(totals)]
    assert all(step >= again for step, _ in longest[-1])
    forgotten = {robot.forgotten for robot in team.robots.values()}
    assert len(forgotten) == 1
