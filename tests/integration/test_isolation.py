"""No robot hears more than the graph allows: real processes, each with an ear on ``**`` at all of its links.

In the open profile neighbours find each other when they ask who is there, and strangers get in; in the secure profile
there is nothing to be found, and how strangers fare there is ``test_security``'s matter.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
import zenoh

from coheft.app.run.keys import make_keys
from coheft.wire.messages.requests import PauseRequest, StatusRequest, StopRequest
from coheft.wire.transport.sessions import open_session

from .eavesdropping_agent import ASK_EVERY
from .team import Team, running_team, small_scenario, wait_until

PLAIN_CLIENTS: list[dict[str, object]] = [{}, {"gateway": {"south": []}}]
"""Clients with Zenoh's own settings and with ours: refused at the door."""
PUSHING_CLIENT: dict[str, object] = {"gateway": {"south": [{}]}}
"""A client that takes everyone for its subordinate gets in."""
SPY_AGENT = (str(Path(__file__).with_name("eavesdropping_agent.py")),)
COUNT = 4
Heard = dict[str, dict[str, dict[str, list[str]]]]
"""By robot, plane, and sense: keys."""


class Stranger:
    """A process beside the team, here the test's own, that hears all it can and speaks under keys of its own."""

    def __init__(self, session: zenoh.Session, name: str) -> None:
        self.name = name
        self.heard: set[str] = set()
        self._marker = session.declare_publisher(f"leak/{name}", congestion_control=zenoh.CongestionControl.BLOCK)
        self._kept = [
            session.declare_subscriber(
                "**", lambda sample: self.heard.add(str(sample.key_expr)), allowed_origin=zenoh.Locality.REMOTE
            ),
            session.declare_queryable(f"leak/{name}", self._answer),
            session.liveliness().declare_token(f"leak/{name}"),
        ]

    def _answer(self, query: zenoh.Query) -> None:
        with query:
            query.reply(f"leak/{self.name}", b"")

    def speak(self) -> None:
        self._marker.put(b"")


@contextmanager
def client(endpoint: str, settings: dict[str, object]) -> Iterator[zenoh.Session]:
    """A session in client mode."""
    common = {"mode": "client", "scouting": {"multicast": {"enabled": False}}, "connect": {"endpoints": [endpoint]}}
    with zenoh.open(zenoh.Config.from_json5(json.dumps(common | settings))) as session:
        yield session


@contextmanager
def careless_peer(*endpoints: str) -> Iterator[zenoh.Session]:
    """A peer with Zenoh's own settings, which tells everyone of everyone."""
    config = zenoh.Config.from_json5(
        json.dumps(
            {
                "mode": "peer",
                "scouting": {"multicast": {"enabled": False}},
                "listen": {"endpoints": ["tcp/127.0.0.1:0"]},
                "connect": {"endpoints": endpoints},
            }
        )
    )
    with zenoh.open(config) as session:
        yield session


def let_run(team: Team, blocks: int, strangers: Sequence[Stranger]) -> None:
    """Let the team simulate so many blocks from now on, while strangers speak again and again."""
    target = team.ask(StatusRequest()).block + blocks

    def has_passed() -> bool:
        for stranger in strangers:
            stranger.speak()
        return team.ask(StatusRequest()).block >= target

    wait_until(has_passed, f"block {target}")


def finish(team: Team) -> Heard:
    """Stop the run; what each robot has heard."""
    team.ask(StopRequest())
    names = list(team.plan.agents)
    for name in names:
        assert team.exit_status(name) == 0, team.log(name)
        assert team.refusals(name) == []
    return {name: json.loads((team.folder / f"{name}.json").read_text()) for name in names}


def check_one_hop(team: Team, heard: Heard, strangers: dict[tuple[str, str], set[str]]) -> None:
    """Check what each robot has heard on each plane: no less than it must, no more than it may.

    Args:
        team: The team.
        heard: What they heard.
        strangers: Names of strangers who are linked with a robot's session, by robot and plane.
    """
    keys = team.keys
    for name, planes in heard.items():
        neighbours = team.plan.server.neighbours[name]
        must = {
            "robot": {keys.robot(name, "measurements")},
            "neighbour": {keys.agent(other, "block") for other in neighbours},
            "observer": set(),
        }
        may = {
            "robot": {keys.robot(name, "stop")},
            "neighbour": {keys.agent(other, "hello") for other in neighbours},
            "observer": set(),
        }
        who = {
            "robot": set(),
            "neighbour": {f"leak/neighbour/{other}" for other in neighbours},
            "observer": set(),
        }
        for plane, senses in planes.items():
            linked = {f"leak/{stranger}" for stranger in strangers.get((name, plane), set())}
            assert must[plane] | linked <= set(senses["heard"]) <= must[plane] | may[plane] | linked, (name, plane)
            if team.plan.keys is not None:
                assert not senses["answered"], (name, plane)
                assert set(senses["alive"]) == {f"leak/{plane}/{name}"}, (name, plane)
                continue
            assert set(senses["answered"]) == who[plane] | linked, (name, plane)
            assert set(senses["alive"]) - {f"leak/{plane}/{name}"} == who[plane] | linked, (name, plane)


@pytest.mark.parametrize(("kind", "profile"), [("ring", "open"), ("star", "secure")])
def test_robots_hear_their_neighbours_and_their_own_sensors_only(kind, profile, tmp_path):
    scenario, keys_folder = small_scenario(COUNT, kind), tmp_path / "keys" if profile == "secure" else None
    if keys_folder is not None:
        make_keys(keys_folder, scenario)
    with running_team(scenario, tmp_path, agent_command=SPY_AGENT, keys_folder=keys_folder) as team:
        team.wait_for_block(3 * ASK_EVERY)
        check_one_hop(team, finish(team), {})


def test_strangers_carry_nothing_from_one_robot_to_another(tmp_path):
    """In a line: clients at a robot's neighbour port and at the server, a careless peer at both ends, an observer."""
    with running_team(small_scenario(COUNT, "line"), tmp_path, agent_command=SPY_AGENT) as team, ExitStack() as stack:
        plan, keys = team.plan, team.keys
        first, second, _, last = plan.agents
        team.wait_for_block(1)
        team.ask(PauseRequest(paused=True))
        for endpoint in (plan.agents[first].listen, plan.server.robots[second]):
            for settings in PLAIN_CLIENTS:
                with pytest.raises(zenoh.ZError, match="Unable to connect"), client(endpoint, settings):
                    pass
        at_robot = Stranger(stack.enter_context(client(plan.agents[first].listen, PUSHING_CLIENT)), "client_at_robot")
        at_server = Stranger(
            stack.enter_context(client(plan.server.robots[second], PUSHING_CLIENT)), "client_at_server"
        )
        careless = Stranger(
            stack.enter_context(careless_peer(plan.agents[first].listen, plan.agents[last].listen)), "careless"
        )
        everywhere = [plan.server.observe, *(agent.observe for agent in plan.agents.values())]
        observer = Stranger(stack.enter_context(open_session(connect=everywhere)), "observer")
        team.ask(PauseRequest(paused=False))

        estimates = {keys.observe_agent(name, "estimate") for name in plan.agents}
        blocks = {name: keys.agent(name, "block") for name in plan.agents}
        wait_until(lambda: {keys.observe_server("truth"), *estimates} <= observer.heard, "the observer's ear")
        wait_until(lambda: blocks[first] in at_robot.heard, "the client's ear at a robot")
        wait_until(lambda: keys.robot(second, "measurements") in at_server.heard, "the client's ear at the server")
        wait_until(lambda: {blocks[first], blocks[last]} <= careless.heard, "the careless peer's ears")
        let_run(team, 3 * ASK_EVERY, [at_robot, at_server, careless, observer])
        strangers = {(name, "observer"): {"observer"} for name in plan.agents}
        strangers[first, "neighbour"] = {"client_at_robot", "careless"}
        strangers[last, "neighbour"] = {"careless"}
        check_one_hop(team, finish(team), strangers)

        # Strangers hear those whom they dial, and no one else through them.
        assert at_robot.heard <= {blocks[first], keys.agent(first, "hello")}
        assert at_server.heard <= {keys.robot(second, topic) for topic in ("measurements", "stop")}
        assert careless.heard <= {keys.agent(name, topic) for name in (first, last) for topic in ("hello", "block")}
        assert all("/observe/" in key for key in observer.heard)
