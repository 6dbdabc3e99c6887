"""What everybody should know reaches everybody, in as many blocks as it has hops to go."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from coheft.wire.codec import encode
from coheft.wire.messages import LinkState, NeighbourMessage
from coheft.wire.scenario import Graph
from consensus.gossip import Gossip
from consensus.graph import Neighbours, build_graph, diameter
from tests.estimation.team import random_pose
from tests.test_graph import graphs, names

Edge = tuple[str, str]


class Team:
    """Robots that gossip along a graph."""

    def __init__(self, graph: Neighbours) -> None:
        self.graph = graph
        self.robots = {name: Gossip(name, others) for name, others in graph.items()}

    def block(self, lost: Collection[Edge] = ()) -> dict[str, list[LinkState]]:
        """Everybody tells its neighbours; messages (to, from) in ``lost`` do not arrive. Returns what was told."""
        told = {name: robot.news() for name, robot in self.robots.items()}
        for name, others in self.graph.items():
            for other in others:
                if (name, other) not in lost:
                    self.robots[name].hear(told[other])
        return told


@given(graphs)
def test_everybody_learns_the_graph_within_its_diameter(graph: Neighbours) -> None:
    team = Team(graph)
    for block in range(diameter(graph)):
        for name, robot in team.robots.items():
            # What is known too early cannot be the whole graph: nobody believes half of it.
            assert robot.graph is None or robot.graph == graph, (block, name)
        team.block()
    for robot in team.robots.values():
        assert robot.graph == graph


@given(graphs, st.data())
def test_the_start_is_the_same_everywhere_and_known_in_time(graph: Neighbours, data: st.DataObject) -> None:
    team = Team(graph)
    ready_at = {name: data.draw(st.integers(0, 30)) for name in graph}
    margin = 2 * len(graph)
    for block in range(40 + margin):
        for name, robot in team.robots.items():
            if ready_at[name] == block:
                robot.announce_ready(block + margin)
        starts = {robot.start_block for robot in team.robots.values()}
        if starts != {None} and len(starts) > 1:
            # Some know, others not yet: the start must lie ahead still.
            assert all(start is None or start > block for start in starts)
        team.block()
    assert {robot.start_block for robot in team.robots.values()} == {max(ready_at.values()) + margin}


@given(graphs, st.integers(0, 10**6))
def test_lost_messages_are_made_up_for(graph: Neighbours, seed: int) -> None:
    rng = np.random.default_rng(seed)
    team = Team(graph)
    edges = [(name, other) for name, others in graph.items() for other in others]
    for block in range(30):
        if block == 10:
            for robot in team.robots.values():
                robot.announce_ready(100)
        team.block(lost={edge for edge in edges if rng.random() < 0.3})
    # Without losses, everything has been told again to all neighbours after one turn per hop.
    for _ in range(len(graph) * diameter(graph)):
        team.block()
    for robot in team.robots.values():
        assert robot.graph == graph
        assert robot.start_block == 100


def test_messages_do_not_grow_with_the_team() -> None:
    sizes = {}
    for n in (6, 12, 24):
        team = Team(build_graph(Graph(kind="ring"), names(n)))
        for _ in range(3 * n):
            team.block()
        sizes[n] = max(
            len(encode(NeighbourMessage(sender="r00", block=1, gossip=records, channels={}), "key"))
            for _ in range(n)
            for records in team.block().values()
        )
    assert sizes[6] == sizes[12] == sizes[24]


def test_only_a_robot_itself_says_what_is_new_about_it() -> None:
    robot = Gossip("a", ["b"])
    robot.hear([LinkState("a", 99, ("x",)), LinkState("b", 2, ("a",), ready_block=5)])
    robot.hear([LinkState("b", 1, ("a", "c"))])  # older: came late
    assert robot.graph == {"a": ("b",), "b": ("a",)}
    assert robot.start_block is None
    robot.announce_ready(3)
    assert robot.start_block == 5


@given(graphs)
def test_poses_are_handed_on_exactly(graph: Neighbours) -> None:
    rng = np.random.default_rng(0)
    team = Team(graph)
    poses = {name: random_pose(rng) for name in graph}
    for name, robot in team.robots.items():
        robot.announce_ready(7, poses[name])
    for _ in range(diameter(graph)):
        team.block()
    for robot in team.robots.values():
        for name, pose in poses.items():
            found = robot.pose(name)
            assert found is not None
            np.testing.assert_array_equal(found.numbers(), pose.numbers())


def test_who_told_no_pose_has_none() -> None:
    robot = Gossip("a", ["b"])
    robot.announce_ready(3)
    assert robot.pose("a") is None
