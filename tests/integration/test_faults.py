"""Processes that are killed, frozen or cut off from each other: the others go on, and in the end all is well again."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from contextlib import ExitStack

import pytest
from msgspec import structs

from coheft.app.run.keys import make_keys
from coheft.app.run.plan import Plan
from coheft.wire.messages.requests import HoldRequest, StatusRequest

from .relayed import Edge, with_relays
from .team import LIMIT, SERVER, Team, running_team, small_scenario, wait_until
from .watcher import Watcher, watching

BLOCK = 50
"""Samples: ten blocks a second, so that even a machine with much else to do keeps pace."""
LATE_SERVER = ("-m", "tests.integration.late_server")
LASTS = 2.0
"""How long a process is frozen; its links are cut after half of that [s]."""


def block_of(team: Team) -> int:
    return team.ask(StatusRequest()).block


def listen_until(watcher: Watcher, moment: float) -> None:
    while (left := moment - time.monotonic()) > 0.0:
        watcher.listen(left)


def wait_until_told(watcher: Watcher, source: str, words: str, since: float) -> None:
    watcher.wait_until(lambda: watcher.is_told(source, words, since) is not None, f"{source} to say: {words}")


@pytest.mark.parametrize("profile", ["open", "secure"])
def test_an_agent_that_is_killed_comes_back_and_everybody_is_valid_again(profile, tmp_path):
    scenario, keys = small_scenario(3, block=BLOCK), None
    if profile == "secure":
        keys = tmp_path / "keys"
        make_keys(keys, scenario)
    with running_team(scenario, tmp_path, "realtime", keys_folder=keys) as team, watching(team) as watcher:
        watcher.wait_until_valid()
        killed = time.monotonic()
        team.kill("r2")
        for other in ("r1", "r3"):
            wait_until_told(watcher, other, "r2 is silent, after block", killed)
            wait_until_told(watcher, other, "stale: r2 is silent since", killed)
        wait_until(lambda: "lost the link with r2" in team.log("server"), "the server to notice")
        block = block_of(team)
        wait_until(lambda: block_of(team) >= block + 10, "time to go on")
        del watcher.latest["r2"]
        team.restart("r2")
        watcher.wait_until(lambda: "r2" in watcher.latest, "the new process")
        assert watcher.latest["r2"].status == "starting"
        watcher.wait_until_valid(block_of(team))
        assert "r2 is back before block" in team.log("server")
        for other in ("r1", "r3"):
            assert watcher.is_told(other, "r2 is back", killed)
            assert team.processes[other].poll() is None
        assert watcher.worst < 5.0


def test_an_agent_that_is_frozen_goes_on_where_the_others_are(tmp_path):
    with running_team(small_scenario(3, block=BLOCK), tmp_path, "realtime") as team, watching(team) as watcher:
        watcher.wait_until_valid()
        frozen = time.monotonic()
        team.processes["r2"].send_signal(signal.SIGSTOP)
        listen_until(watcher, frozen + LASTS)
        for other in ("r1", "r3"):
            wait_until_told(watcher, other, "stale: r2 is silent since", frozen)
        block = block_of(team)
        team.processes["r2"].send_signal(signal.SIGCONT)
        watcher.wait_until_valid(block)
        assert watcher.worst < 5.0
        assert "restarted" not in team.log("r2")


def test_a_robot_that_lets_go_leaves_the_team_and_comes_back(tmp_path):
    with running_team(small_scenario(4, block=BLOCK), tmp_path, "realtime") as team, watching(team) as watcher:
        watcher.wait_until_valid()
        assert "no robot r9: the robots are r1, r2, r3, r4" in team.refusal(HoldRequest(robot="r9", holding=False))
        let_go = time.monotonic()
        assert "r2 already holds the payload" in team.refusal(HoldRequest(robot="r2", holding=True))
        block = team.ask(HoldRequest(robot="r2", holding=False)).block
        assert "r2 has already released the payload" in team.refusal(HoldRequest(robot="r2", holding=False))
        wait_until_told(watcher, "r2", "the robot does not hold the load", let_go)
        others = ("r1", "r3", "r4")
        watcher.wait_until(
            lambda: all(
                watcher.latest[name].status == "valid"
                and watcher.latest[name].members == 3
                and watcher.latest[name].valid_block > block
                for name in others
            ),
            "the others to go on without it",
        )
        watcher.wait_until_valid(team.ask(HoldRequest(robot="r2", holding=True)).block)
        assert all(estimate.members == 4 for estimate in watcher.latest.values())
        assert watcher.worst < 5.0


def test_the_last_one_may_not_let_go(tmp_path):
    with running_team(small_scenario(2, "line", block=BLOCK), tmp_path, "realtime") as team:
        team.wait_for_block(1)
        team.ask(HoldRequest(robot="r1", holding=False))
        assert "r2 is the only robot that holds" in team.refusal(HoldRequest(robot="r2", holding=False))
        team.wait_for_block(team.ask(StatusRequest()).block + 10)
        assert all(process.poll() is None for process in team.processes.values())


def relayed(edges: list[Edge], stack: ExitStack) -> tuple[Callable[[Plan], Plan], dict]:
    relays = {}

    def change(plan: Plan) -> Plan:
        plan, made = with_relays(plan, edges, stack)
        relays.update(made)
        return plan

    return change, relays


def test_a_frozen_link_silences_two_neighbours_for_each_other_only(tmp_path):
    with ExitStack() as stack:
        change, relays = relayed([("r1", "r2")], stack)
        team = stack.enter_context(running_team(small_scenario(3, block=BLOCK), tmp_path, "realtime", change=change))
        watcher = stack.enter_context(watching(team))
        watcher.wait_until_valid()
        frozen = time.monotonic()
        relays["r1", "r2"].freeze()
        wait_until_told(watcher, "r1", "stale: r2 is silent since", frozen)
        wait_until_told(watcher, "r2", "stale: r1 is silent since", frozen)
        wait_until_told(watcher, "r1", "r2 is silent, after block", frozen)  # its lease has ended
        block = block_of(team)
        watcher.wait_until(
            lambda: watcher.latest["r3"].block > block and watcher.latest["r3"].silent == [], "r3 to hear both"
        )
        relays["r1", "r2"].thaw()
        watcher.wait_until_valid(block_of(team))
        assert watcher.worst < 5.0


def test_a_link_that_is_too_slow_does_not_slow_down_the_agents(tmp_path):
    with ExitStack() as stack:
        change, relays = relayed([("r1", "r2")], stack)
        team = stack.enter_context(running_team(small_scenario(3, block=BLOCK), tmp_path, "realtime", change=change))
        watcher = stack.enter_context(watching(team))
        watcher.wait_until_valid()
        slowed = time.monotonic()
        relays["r1", "r2"].rate = 5e3
        wait_until_told(watcher, "r1", "stale: r2 is silent since", slowed)
        wait_until_told(watcher, "r2", "stale: r1 is silent since", slowed)
        block = block_of(team)
        watcher.wait_until(lambda: all(e.block > block + 10 for e in watcher.latest.values()), "both ends to go on")
        relays["r1", "r2"].rate = float("inf")
        watcher.wait_until_valid(block_of(team))
        assert watcher.worst < 5.0


def test_a_team_that_is_cut_in_two_and_joined_again_is_valid_again(tmp_path):
    edges = [("r1", "r4"), ("r2", "r3")]
    with ExitStack() as stack:
        change, relays = relayed(edges, stack)
        team = stack.enter_context(running_team(small_scenario(4, block=BLOCK), tmp_path, "realtime", change=change))
        watcher = stack.enter_context(watching(team))
        watcher.wait_until_valid()
        cut = time.monotonic()
        for relay in relays.values():
            relay.cut()
        for one, other in edges:
            wait_until_told(watcher, one, f"stale: {other} is silent since", cut)
            wait_until_told(watcher, other, f"stale: {one} is silent since", cut)
        block = block_of(team)
        watcher.wait_until(lambda: all(e.block > block + 10 for e in watcher.latest.values()), "both halves to go on")
        assert all(estimate.status == "stale" for estimate in watcher.latest.values())
        for relay in relays.values():
            relay.heal()
        watcher.wait_until_valid(block_of(team))
        assert watcher.worst < 5.0


@pytest.mark.parametrize("clock", ["lockstep", "realtime"])
def test_agents_work_with_a_new_server_as_with_the_old_one(clock, tmp_path):
    with running_team(small_scenario(3, block=BLOCK), tmp_path, clock) as team, watching(team) as watcher:
        watcher.wait_until_valid()
        killed = time.monotonic()
        team.kill("server")
        for name in team.plan.agents:
            wait_until_told(watcher, name, "stale: lost the link with the server", killed)
        watcher.latest.clear()
        team.restart("server")
        watcher.wait_until(lambda: len(watcher.latest) == len(team.plan.agents), "a new beginning")
        watcher.wait_until_valid()
        for name in team.plan.agents:
            assert "the server has restarted, so this agent restarts, too" in team.log(name)
        assert watcher.worst < 5.0


def patient(plan: Plan) -> Plan:
    return Plan(structs.replace(plan.server, return_limit=LIMIT), plan.agents)


def test_lockstep_waits_for_a_robot_that_comes_back(tmp_path):
    with running_team(small_scenario(3), tmp_path, change=patient) as team, watching(team) as watcher:
        watcher.wait_until_valid()
        team.kill("r2")
        wait_until(lambda: "r2" in team.ask(StatusRequest()).waiting_for, "the server to notice")
        block = block_of(team)
        team.restart("r2")
        watcher.wait_until_valid(block)
        assert f"r2 is back before block {block}" in team.log("server")
        assert "continues without it" not in team.log("server")
        assert watcher.worst < 5.0


def impatient(plan: Plan) -> Plan:
    agents = {name: structs.replace(agent, server_limit=0.5) for name, agent in plan.agents.items()}
    return Plan(structs.replace(plan.server, return_limit=0.5), agents)


def test_lockstep_goes_on_without_a_robot_that_does_not_come_back_and_takes_it_in_when_it_does(tmp_path):
    with running_team(small_scenario(3), tmp_path, change=impatient) as team, watching(team) as watcher:
        watcher.wait_until_valid()
        team.kill("r2")

        def has_given_up() -> bool:
            team.status()  # whoever asks does not keep it from looking at its clock
            return "r2 did not return within 0.5 s" in team.log("server")

        wait_until(has_given_up, "the server to give up")
        block = block_of(team)
        wait_until(lambda: block_of(team) > block + 100, "time to go on")
        watcher.wait_until(lambda: watcher.latest["r1"].block > block, "a robot that goes on")
        assert watcher.latest["r1"].status == "stale"
        team.restart("r2")
        watcher.wait_until_valid(block_of(team))
        assert watcher.worst < 5.0


@pytest.mark.parametrize("command", [SERVER, LATE_SERVER], ids=["in time", "always behind real time"])
def test_a_server_whose_robots_are_all_gone_ends_and_says_so(command, tmp_path):
    scenario = small_scenario(2, "line")
    with running_team(scenario, tmp_path, "realtime", change=impatient, server_command=command) as team:
        team.wait_for_block(10)
        for name in team.plan.agents:
            team.kill(name)
        assert team.exit_status("server") == 1
        assert team.log("server").endswith("all robots are lost, and none returned within 0.5 s\n")


def test_agents_whose_server_does_not_come_back_end_and_say_so(tmp_path):
    with running_team(small_scenario(2, "line"), tmp_path, change=impatient) as team:
        team.wait_for_block(10)
        team.kill("server")
        for name in team.plan.agents:
            assert team.exit_status(name) == 1
            assert team.log(name).endswith("it did not come back within 0.5 s\n")
