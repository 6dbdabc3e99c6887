"""Links that the operator cuts: to the agents a neighbour that has gone silent, and back when they are mended."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from coheft.app.run.keys import make_keys
from coheft.app.run.observer import Observer, disturb_links, observe, set_link
from coheft.errors import CoheftError, LinkError
from coheft.wire.messages.requests import CutLinks, LinkRequest, StatusRequest, StopRequest
from coheft.wire.messages.structs import Estimate
from coheft.wire.messages.truth import Scene
from coheft.wire.scenario.network import LinkQuality
from coheft.wire.transport.planes import guard_observer
from coheft.wire.transport.security import credentials_in
from coheft.wire.transport.sessions import ask, open_session

from .team import running_team, small_scenario, wait_until

WHOLE: dict[str, list[str]] = {"r1": [], "r2": [], "r3": []}


def silence_told_to(observer: Observer, scene: Scene) -> Callable[[dict[str, list[str]]], bool]:
    """Whether robots name these silent neighbours, as far as the observer has heard by the time it is asked."""
    silent: dict[str, list[str]] = {}

    def says(expected: dict[str, list[str]]) -> bool:
        for news in observer.collect(scene, 0.1):
            if isinstance(news, Estimate):
                silent[news.robot] = news.silent
        return silent == expected

    return says


def test_a_link_that_is_cut_is_silent_at_both_ends_until_it_is_mended(tmp_path):
    with running_team(small_scenario(3, "line"), tmp_path) as team:
        team.wait_for_block(10)
        run_file = team.plan.run_file()
        scene = team.ask(StatusRequest()).scene
        with observe(run_file) as observer:
            says = silence_told_to(observer, scene)
            wait_until(lambda: says(WHOLE), "a team that talks")
            for one, other in (("r1", "r2"), ("r2", "r1")):
                set_link(run_file, scene, one, other, cut=True)
                wait_until(lambda: says({"r1": ["r2"], "r2": ["r1"], "r3": []}), "silence at both ends")
                set_link(run_file, scene, one, other, cut=True)  # no harm
                block = team.ask(StatusRequest()).block
                team.wait_for_block(block + 200)
                assert says({"r1": ["r2"], "r2": ["r1"], "r3": []}), "no robot dials meanwhile"
                set_link(run_file, scene, one, other, cut=False)
                wait_until(lambda: says(WHOLE), "the link to be back")
        with pytest.raises(CoheftError, match="there is no link r1-r3; the links are r1-r2, r2-r3"):
            set_link(run_file, scene, "r1", "r3", cut=True)
        with open_session(connect=[run_file.agents["r1"]]) as session:

            def refusal() -> str:
                try:
                    answer = ask(
                        CutLinks, session, team.keys.request_agent("r1"), LinkRequest(neighbour="r2", cut=True)
                    )
                except LinkError:
                    return ""
                return getattr(answer, "reason", "")

            wait_until(lambda: "r1 dials no neighbour: only the robot that dials r2 can cut" in refusal(), "a refusal")
        team.ask(StopRequest())
        assert all(team.exit_status(name) == 0 for name in team.plan.agents)
        assert "the operator has cut the link with r1" in team.log("r2")
        assert "the operator has mended the link with r1" in team.log("r2")


def test_in_a_secure_run_only_the_operator_cuts_links(tmp_path):
    scenario = small_scenario(2, "line")
    make_keys(tmp_path / "keys", scenario)
    with running_team(scenario, tmp_path, keys_folder=tmp_path / "keys") as team:
        team.wait_for_block(10)
        run_file = team.plan.run_file()
        scene = team.ask(StatusRequest()).scene
        guard = guard_observer(credentials_in(tmp_path / "keys", "observer"), team.keys, "observer", ["r2"])
        with (
            open_session(connect=[run_file.agents["r2"]], guard=guard) as session,
            pytest.raises(LinkError, match="no answer"),
        ):
            ask(CutLinks, session, team.keys.request_agent("r2"), LinkRequest(neighbour="r1", cut=True))
        set_link(run_file, scene, "r1", "r2", cut=True)
        wait_until(lambda: "the operator has cut the link with r1" in team.log("r2"), "the link to be cut")
        assert team.log("r2").count("the operator has cut") == 1
        team.ask(StopRequest())


def test_a_link_that_loses_everything_is_silent_at_both_ends_until_it_is_restored(tmp_path):
    with running_team(small_scenario(3, "line"), tmp_path) as team:
        team.wait_for_block(10)
        run_file = team.plan.run_file()
        scene = team.ask(StatusRequest()).scene
        with observe(run_file) as observer:
            says = silence_told_to(observer, scene)
            wait_until(lambda: says(WHOLE), "a team that talks")
            disturb_links(run_file, scene, "r1", "r2", LinkQuality(loss=1.0))
            wait_until(lambda: says({"r1": ["r2"], "r2": ["r1"], "r3": []}), "silence at both ends")
            disturb_links(run_file, scene, "r2", "r1", LinkQuality())
            wait_until(lambda: says(WHOLE), "the link to be restored")
            disturb_links(run_file, scene, "r2", "r3", LinkQuality(delay=0.25))  # more than ten blocks
            block = team.ask(StatusRequest()).block
            team.wait_for_block(block + 50)
            assert says(WHOLE), "late messages are heard as well"
        with pytest.raises(CoheftError, match="there is no link r1-r3; the links are r1-r2, r2-r3"):
            disturb_links(run_file, scene, "r1", "r3", LinkQuality())
        team.ask(StopRequest())
        assert all(team.exit_status(name) == 0 for name in team.plan.agents)
        assert "the operator has disturbed the link from r1" in team.log("r2")
        assert "the operator has restored the link from r2" in team.log("r1")
