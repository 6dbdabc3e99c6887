"""What every robot should know reaches every robot, in as many blocks as it has hops to go."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from coheft.consensus.gossip import Gossip
from coheft.consensus.graph import Neighbours, build_graph, diameter, distances
from coheft.wire.messages.codec import encode
from coheft.wire.messages.limits import PER_MESSAGE
from coheft.wire.messages.structs import LinkState, NeighbourMessage
from coheft.wire.scenario.schema import MAX_ROBOTS, Graph
from tests.test_graph import graphs, names

Edge = tuple[str, str]


class Team:
    """Robots that gossip along a graph."""

    def __init__(self, graph: Neighbours) -> None:
        self.graph = graph
        self.robots = {name: Gossip(name, others) for name, others in graph.items()}

    def blocks(self, count: int) -> None:
        for _ in range(count):
            self.block()

    def meet(self) -> None:
        """Go on until every robot knows the graph."""
        self.blocks(diameter(self.graph))

    def start(self, block: int) -> None:
        """Every robot meets, and agrees upon a start at a block."""
        self.meet()
        self.everybody_ready(block)
        self.meet()

    def restart(self, name: str) -> None:
        """Its agent dies, and another one with an empty memory takes its place."""
        self.robots[name] = Gossip(name, self.graph[name], self.robots[name].own.incarnation + 1)

    def everybody_ready(self, block: int) -> None:
        for robot in self.robots.values():
            robot.announce_ready(block)

    def make_up(self) -> None:
        """Without losses, everything has been told again to all neighbours after one turn per hop."""
        self.blocks(len(self.graph) * diameter(self.graph))

    def block(self, lost: Collection[Edge] = ()) -> dict[str, list[LinkState]]:
        """Every robot tells its neighbours; messages (to, from) in ``lost`` do not arrive. Returns what was told."""
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
            # What is known too early cannot be the whole graph: no robot believes half of it.
            assert robot.graph is None or robot.graph == graph, (block, name)
        team.block()
    for robot in team.robots.values():
        assert robot.graph == graph


@given(graphs, st.data())
def test_the_start_is_the_same_everywhere_and_known_in_time(graph: Neighbours, data: st.DataObject) -> None:
    team = Team(graph)
    team.meet()
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
    for _ in range(3):
        team.block(lost={edge for edge in edges if rng.random() < 0.3})
    team.make_up()
    assert all(robot.graph == graph for robot in team.robots.values())
    team.everybody_ready(100)
    for _ in range(3):
        team.block(lost={edge for edge in edges if rng.random() < 0.3})
    team.make_up()
    assert all(robot.start_block == 100 for robot in team.robots.values())


def test_messages_do_not_grow_with_the_team() -> None:
    sizes = {}
    for n in (6, 12, 24):
        team = Team(build_graph(Graph(kind="ring"), names(n)))
        team.blocks(3 * n)
        sizes[n] = max(
            len(encode(NeighbourMessage(sender="r00", block=1, gossip=records, channels={}), "key"))
            for _ in range(n)
            for records in team.block().values()
        )
    assert sizes[6] == sizes[12] == sizes[24]


def test_only_a_robot_itself_says_what_is_new_about_it() -> None:
    team = Team({"a": ("b",), "b": ("a",)})
    team.meet()
    a, b = team.robots["a"], team.robots["b"]
    b.announce_ready(5)
    (new,) = (record for record in b.news() if record.robot == "b")
    a.hear([new])
    a.hear([replace(new, sequence=0, neighbours=("a", "c"))])  # older: came late
    assert a.graph == {"a": ("b",), "b": ("a",)}
    assert a.start_block is None
    a.announce_ready(3)
    assert a.start_block == 5
    a.hear([replace(a.own, sequence=99, neighbours=("x",))])
    assert a.graph == {"a": ("b",), "b": ("a",)}
    assert a.start_block is None  # who has believed that has left the team: it has to be another one


# --- teams that change ---


@given(graphs, st.data())
def test_with_a_robot_that_starts_again_it_is_another_team_that_nobody_is_ready_for(
    graph: Neighbours, data: st.DataObject
) -> None:
    team = Team(graph)
    team.start(50)
    (old,) = {robot.membership for robot in team.robots.values()}
    restarted = data.draw(st.sampled_from(sorted(graph)))
    former = team.robots[restarted].own
    team.restart(restarted)
    # It knows of all as soon as its neighbours have heard of it, every robot of it as soon as it was handed on.
    team.blocks(max(2, diameter(graph)))
    for robot in team.robots.values():
        robot.hear([replace(former, sequence=99)])  # came late: from before
        assert robot.graph == graph
        assert robot.membership != old
        assert robot.start_block is None
    assert len({robot.membership for robot in team.robots.values()}) == 1
    team.everybody_ready(100)
    team.meet()
    assert {robot.start_block for robot in team.robots.values()} == {100}


@given(graphs, st.data())
def test_a_robot_that_lets_go_is_no_member_until_it_takes_hold_again(graph: Neighbours, data: st.DataObject) -> None:
    team = Team(graph)
    team.start(10)
    (first,) = {robot.membership for robot in team.robots.values()}
    loose = data.draw(st.sampled_from(sorted(graph)))
    team.robots[loose].announce_holding(False, 30)
    team.meet()
    others = {name: tuple(o for o in neighbours if o != loose) for name, neighbours in graph.items() if name != loose}
    is_connected = 1 < len(others) == len(distances(others, min(others)))  # one alone is no team
    for robot in team.robots.values():
        assert robot.graph == (others if is_connected else None)
        assert robot.start_block is None
    for name in others:
        team.robots[name].announce_ready(20)
    team.meet()
    # No robot begins before it has really let go.
    assert {robot.start_block for robot in team.robots.values()} == {30 if is_connected else None}
    team.robots[loose].announce_holding(True, 60)
    team.meet()
    (last,) = {robot.membership for robot in team.robots.values()}
    assert last != first  # it is the same robots, but one of them holds the load elsewhere
    team.everybody_ready(40)
    team.meet()
    assert {robot.start_block for robot in team.robots.values()} == {60}


events = st.lists(
    st.tuples(st.integers(0, 40), st.integers(0, 15), st.sampled_from(["restart", "let go", "take hold", "ready"])),
    max_size=12,
)


@given(graphs, events, st.floats(0.0, 0.9), st.integers(0, 10**6))
def test_whatever_happened_everybody_comes_to_know_the_same(
    graph: Neighbours, events: list[tuple[int, int, str]], loss: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    team = Team(graph)
    edges = [(name, other) for name, others in graph.items() for other in others]
    for block in range(40):
        for at, number, what in events:
            name = sorted(graph)[number % len(graph)]
            robot = team.robots[name]
            if at != block:
                continue
            if what == "restart":
                team.restart(name)
            elif what == "ready":
                robot.announce_ready(block + 5)
            else:
                robot.announce_holding(what == "take hold", block)
        team.block(lost={edge for edge in edges if rng.random() < loss})
    team.make_up()
    one, *others = team.robots.values()
    assert one.records == {name: robot.own for name, robot in team.robots.items()}
    for robot in others:
        assert robot.records == one.records
        assert (robot.graph, robot.membership, robot.start_block) == (one.graph, one.membership, one.start_block)


@given(graphs, st.data())
def test_a_record_that_somebody_has_wrong_is_put_right(graph: Neighbours, data: st.DataObject) -> None:
    """As when a bit flips in somebody's memory: newer by mistake, as new as the right one, or older."""
    team = Team(graph)
    team.start(7)
    holder, about = (data.draw(st.sampled_from(sorted(graph))) for _ in range(2))
    record = team.robots[about].own
    wrong = replace(
        record,
        sequence=record.sequence + data.draw(st.sampled_from([-1, 0, 0, 16, 2**40])),
        incarnation=record.incarnation + data.draw(st.sampled_from([0, 0, 8])),
        ready_block=data.draw(st.sampled_from([7, 0, 1031])),
        since=data.draw(st.sampled_from([0, 0, 64])),
    )
    if holder != about:
        team.robots[holder].hear([wrong])
        team.robots[holder].records[about] = wrong
    for _ in range(2):
        team.make_up()
    everything = [robot.records for robot in team.robots.values()]
    assert all(records == everything[0] for records in everything)
    right = team.robots[about].own
    assert (right.ready_block, right.since) == (7, 0)


@given(graphs, st.data())
def test_a_robot_that_nobody_names_as_a_neighbour_is_there_by_mistake(graph: Neighbours, data: st.DataObject) -> None:
    """As when a bit flips in a robot's name."""
    team = Team(graph)
    holder, original = (data.draw(st.sampled_from(sorted(graph))) for _ in range(2))
    mistake = replace(team.robots[original].own, robot="mistake", since=10**6)
    team.robots[holder].hear([mistake, replace(mistake, robot="another", neighbours=("mistake", "nobody"))])
    for _ in range(2):
        team.make_up()
    team.everybody_ready(7)
    team.make_up()
    for robot in team.robots.values():
        assert robot.graph == graph
        assert robot.start_block == 7


def test_made_up_robots_keep_no_team_from_starting_and_are_not_handed_on() -> None:
    """As many as 1,100, which come before the true ones are known and name each other."""
    team = Team(build_graph(Graph(kind="line"), names(5)))
    made_up = [LinkState(f"x{number}", 0, (f"x{number - 1}",)) for number in range(1, 1101)]
    for first in range(0, len(made_up), 10):
        team.robots["r01"].hear(made_up[first : first + 10])
        told = team.block()
        assert not any(record.robot.startswith("x") for records in told.values() for record in records)
    team.everybody_ready(200)
    team.meet()
    for robot in team.robots.values():
        assert robot.graph == team.graph
        assert robot.start_block == 200
    assert len(team.robots["r01"].records) == 5


@pytest.mark.parametrize("is_told", ["robots as well", "names only"])
def test_a_robot_that_makes_up_neighbours_keeps_a_team_waiting_until_it_starts_again(is_told: str) -> None:
    team = Team(build_graph(Graph(kind="line"), names(5)))
    team.meet()
    made_up = [f"x{number}" for number in range(MAX_ROBOTS)]
    liar = team.robots["r02"]
    liar._publish(replace(liar.own, neighbours=("r01", "r03", *made_up)))
    if is_told == "robots as well":
        for name in made_up:
            liar.hear([LinkState(name, 0, ("r02",))])
    team.blocks(2 * MAX_ROBOTS // PER_MESSAGE)
    assert team.robots["r00"].start_block is None
    for robot in team.robots.values():
        assert len(robot.records) <= MAX_ROBOTS
    team.restart("r02")
    team.make_up()
    team.everybody_ready(200)
    team.make_up()
    for robot in team.robots.values():
        assert robot.graph == team.graph
        assert robot.start_block == 200
        assert len(robot.records) == 5


def test_a_record_that_overtakes_the_one_that_names_its_robot_is_kept() -> None:
    robot = Gossip("a", ("b",))
    robot.hear([LinkState("c", 0, ("b",))])
    assert "c" not in robot.records
    robot.hear([LinkState("b", 0, ("a", "c"))])
    assert robot.graph == {"a": ("b",), "b": ("a", "c"), "c": ("b",)}
    assert {record.robot for record in robot.news()} == {"a", "b", "c"}


def test_robots_that_nothing_was_heard_of_are_named() -> None:
    team = Team(build_graph(Graph(kind="line"), names(4)))
    team.block()
    assert team.robots["r00"].unknown() == ["r02"]
    team.meet()
    assert team.robots["r00"].unknown() == []
