"""The server's and the agents' processes: what they do is what the pure parts do, and nothing bad stops them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from contextlib import ExitStack

import numpy as np
import pytest

from coheft.app.run.inprocess import run_in_process
from coheft.app.run.plan import make_plan
from coheft.estimation.geometry.spatial import Array
from coheft.wire.messages.codec import encode
from coheft.wire.messages.frame import PROTOCOL_VERSION
from coheft.wire.messages.requests import InjectRequest, PauseRequest, RemoveRequest, Status, StatusRequest, StopRequest
from coheft.wire.messages.structs import Estimate, LinkState, Message, NeighbourMessage, Problem, Ready, Reference
from coheft.wire.messages.truth import LoadState, Truth
from coheft.wire.process.supervised import TERMINATED
from coheft.wire.transport.inbox import Inbox, Received
from coheft.wire.transport.sessions import Keys, Sender, open_session
from tests.fuzz.any_message import of_version

from .team import LIMIT, ROOT, Team, running_team, small_scenario, wait_until

GENTLE = {"mass": 0.5, "position": (0.1, 0.0, 0.1)}


def test_processes_give_the_same_numbers_as_the_pure_parts_bit_for_bit(tmp_path):
    scenario = small_scenario(3, "line", duration=6.0)
    with running_team(scenario, tmp_path) as team:
        inbox = Inbox()
        at_server, at_agent = team.keys.observe_server, team.keys.observe_agent
        from_server = {at_server("truth"): Truth, at_server("problem"): Problem, at_server("end"): Status}
        inbox.listen(team.observer, "server", from_server)
        agents_observed = [config.observe for config in team.plan.agents.values()]
        with open_session(connect=agents_observed) as other:
            for name in team.plan.agents:
                inbox.listen(other, name, {at_agent(name, "estimate"): Estimate, at_agent(name, "problem"): Problem})
            records = list(run_in_process(scenario))
            last = records[-1].truth.block
            heard: dict[str, dict[int, bytes]] = {name: {} for name in ("server", *team.plan.agents)}
            while any(last not in blocks for blocks in heard.values()):
                event = inbox.receive(LIMIT)
                assert isinstance(event, Received), event
                if isinstance(event.message, Status):
                    continue  # that it is the end; agents may say their last words later
                assert isinstance(event.message, Truth | Estimate), event
                heard[event.source][event.message.block] = encode(event.message, event.source)
    for source in heard:
        said = [record.truth if source == "server" else record.estimates.get(source) for record in records]
        encoded = {message.block: encode(message, source) for message in said if message is not None}
        # Nothing can be said of what was published before this test's link stood.
        assert heard[source] == {block: encoded[block] for block in heard[source]}, source
        assert len(heard[source]) > len(encoded) // 2


@pytest.mark.parametrize("clock", ["lockstep", "realtime"])
def test_requests_are_carried_out_or_refused_with_a_reason(clock, tmp_path):
    with running_team(small_scenario(2, "line"), tmp_path, clock) as team:
        team.wait_for_block(10)
        assert "mass of a load is -1.0 kg" in team.refusal(InjectRequest(mass=-1.0, position=(0.0, 0.0, 0.0)))
        assert "there is no load 7" in team.refusal(RemoveRequest(load=7))
        status = team.ask(InjectRequest(**GENTLE, size=(0.02, 0.03, 0.04)))
        assert status.slots_free == 1
        assert status.loads == [LoadState(1, 0.5, (0.1, 0.0, 0.1), (0.02, 0.03, 0.04))]
        assert [load.id for load in team.ask(InjectRequest(**GENTLE)).loads] == [1, 2]
        assert "slot" in team.refusal(InjectRequest(**GENTLE))
        assert [load.id for load in team.ask(RemoveRequest(load=1)).loads] == [2]

        status = team.ask(PauseRequest(paused=True))
        assert status.state == "paused"
        assert team.ask(StatusRequest()).block == status.block
        assert team.ask(PauseRequest(paused=False)).state == "running"
        team.wait_for_block(status.block + 10)

        team.ask(StopRequest())
        wait_until(lambda: team.ask(StatusRequest()).state == "finished", "the end of the run")
        assert team.refusal(InjectRequest(**GENTLE)) == "the run is over"
        for name in team.plan.agents:
            assert team.exit_status(name) == 0
        assert all(team.refusals(name) == [] for name in team.plan.agents)


def incarnation_of(name: str, team: Team) -> int:
    """What an agent calls its present life, as anybody can hear who dials it."""
    inbox = Inbox()
    key = team.keys.agent(name, "block")
    with open_session(connect=[team.plan.agents[name].listen]) as session:
        inbox.listen(session, name, {key: NeighbourMessage})
        heard = inbox.receive(LIMIT)
    assert isinstance(heard, Received)
    assert isinstance(heard.message, NeighbourMessage)
    return heard.message.incarnation


def wait_for_refusals(team: Team, process: str, *texts: str) -> None:
    """Wait until a process has refused a message for each of the reasons."""

    def missing() -> list[str]:
        return [text for text in texts if not any(text in line for line in team.refusals(process))]

    wait_until(lambda: not missing(), f"{process} to refuse what is wrong with {missing()}")


def test_bad_messages_are_refused_and_the_run_goes_on(tmp_path):
    """A stranger at a robot's neighbour port and at the server speaks in the names of others."""
    with running_team(small_scenario(3, "line"), tmp_path) as team:
        keys, plan = team.keys, team.plan
        first, second, _ = plan.agents
        team.wait_for_block(2)
        incarnation = incarnation_of(second, team)
        now = team.ask(PauseRequest(paused=True)).block
        wait_until(lambda: not team.ask(StatusRequest()).waiting_for, "the last answers")
        motion = np.zeros((plan.server.scenario.sensors.block, 12))
        robot_key = keys.robot(first, "reference")
        to_server: dict[str, Message | bytes] = {
            "not a Reference": b"rubbish",
            f"version {PROTOCOL_VERSION + 1}": of_version(PROTOCOL_VERSION + 1, Ready(robot=first), robot_key),
            "robot is 'nobody'": Reference(robot="nobody", block=now, answers=now, motion=motion, wrench=np.zeros(6)),
            "has already been answered": Reference(
                robot=first, block=now, answers=now, motion=motion * np.nan, wrench=np.zeros(6)
            ),
        }
        long_past, never = LinkState("r3", 9, (), since=-1), LinkState("r3", 9, (), ready_block=-2)
        not_finite, too_short = np.full((10, 9), np.nan), np.zeros((9, 9))

        def said(block: int, gossip: LinkState | None = None, **channels: Array) -> NeighbourMessage:
            records = [gossip] if gossip else []
            return NeighbourMessage(
                sender=second, block=block, gossip=records, channels=channels, incarnation=incarnation
            )

        to_agent: dict[str, Message | bytes] = {
            "sender is 'nobody'": NeighbourMessage(sender="nobody", block=now, gossip=[], channels={}),
            "1000000": said(1000000),
            ">= 0 - at `$.gossip[0].since`": said(now + 1, long_past),
            ">= -1 - at `$.gossip[0].ready_block`": said(now + 2, never),
            "finite": said(now + 3, kinematics=not_finite),
            "not a NeighbourMessage: its checksum is wrong": b"rubbish",
        }
        harmless = [said(0), said(now), said(now), said(now + 4, kinematics=too_short)]
        with open_session(connect=[plan.server.robots[first], plan.agents[first].listen]) as session:
            references = Sender(session, keys.robot(first, "reference"), may_drop=False)
            blocks = Sender(session, keys.agent(second, "block"), may_drop=False)
            wait_until(lambda: references.has_listener and blocks.has_listener, "the stranger's links")
            for key, messages in (
                (robot_key, to_server.values()),
                (keys.agent(second, "block"), [*harmless, *to_agent.values()]),
            ):
                for message in messages:
                    session.put(key, message if isinstance(message, bytes) else encode(message, key))

            # Blocks that go by change what is wrong with a message: the run stays paused until all have arrived.
            wait_for_refusals(team, "server", *to_server)
            wait_for_refusals(team, first, "not a NeighbourMessage: its checksum is wrong")
            team.ask(PauseRequest(paused=False))
            wait_for_refusals(team, first, *to_agent)
        team.wait_for_block(now + 50)
        team.ask(StopRequest())
        for name in plan.agents:
            assert team.exit_status(name) == 0


FROZEN_OBSERVER = """
import os, signal, sys
from coheft.wire.transport.sessions import open_session

with open_session(connect=sys.argv[1:]) as session:
    subscriber = session.declare_subscriber("**")
    for _ in range(50):
        subscriber.recv()
    os.kill(os.getpid(), signal.SIGSTOP)
"""


def test_observers_that_freeze_do_not_hold_up_the_run(tmp_path):
    with running_team(small_scenario(4), tmp_path) as team, ExitStack() as stack:
        endpoints = [team.plan.server.observe, *(config.observe for config in team.plan.agents.values())]
        observers = [subprocess.Popen([sys.executable, "-c", FROZEN_OBSERVER, *endpoints], cwd=ROOT) for _ in range(3)]
        for observer in observers:
            stack.callback(observer.wait)
            stack.callback(observer.kill)
        for observer in observers:
            os.waitid(os.P_PID, observer.pid, os.WSTOPPED)
        team.wait_for_block(team.ask(StatusRequest()).block + 1500)  # long enough for their links to be cut


def test_no_process_outlives_the_one_that_holds_its_stdin(tmp_path):
    with running_team(small_scenario(2, "line"), tmp_path) as team:
        team.wait_for_block(1)
        team.ask(PauseRequest(paused=True))
        for name, process in team.processes.items():
            assert process.stdin is not None
            process.stdin.close()
            assert team.exit_status(name) == 0


def test_a_request_to_terminate_is_obeyed_and_an_interrupt_is_left_to_the_supervisor(tmp_path):
    with running_team(small_scenario(2, "line"), tmp_path) as team:
        team.wait_for_block(1)
        for process in team.processes.values():
            os.kill(process.pid, signal.SIGINT)
        team.wait_for_block(team.ask(StatusRequest()).block + 50)
        os.kill(team.processes["server"].pid, signal.SIGTERM)
        assert team.exit_status("server") == TERMINATED
        for name in team.plan.agents:
            assert team.exit_status(name) == 0, team.log(name)


def test_a_server_says_once_for_whom_it_waits_and_begins_when_all_are_there(tmp_path):
    plan = make_plan(small_scenario(2, "line"))
    with open_session(connect=[plan.server.observe]) as observer, ExitStack() as stack:
        team = Team(plan, Keys(plan.server.run), tmp_path, observer, {})
        for name in ("server", *plan.agents):
            team.restart(name)
            stack.callback(team.end, name)
            wait_until(lambda: team.log("server") != "", "the server to say something")
        team.wait_for_block(1)
        assert team.log("server") == f"waiting for {', '.join(plan.agents)}\n"


@pytest.mark.parametrize("module", ["coheft.agents.process.main", "coheft.physics_server.server"])
def test_a_process_without_a_usable_configuration_says_so(module):
    done = subprocess.run(
        [sys.executable, "-m", module], input=b'{"run": 1}\n', cwd=ROOT, capture_output=True, timeout=LIMIT, check=False
    )
    assert done.returncode == 2
    assert b"as one line of JSON on stdin" in done.stderr
