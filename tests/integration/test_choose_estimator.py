"""Another estimator while a run goes on: all robots begin anew at the same block, and equal runs stay equal."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest

from coheft.app.run.inprocess import BlockRecord
from coheft.wire.messages.requests import EstimatorRequest
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.schema import Scenario
from tests.in_process import steps
from tests.integration.command_line import Run
from tests.integration.team import Team, running_team, small_scenario
from tests.integration.test_same_numbers import in_one_process
from tests.waiting import wait_until

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals as on POSIX")


def changing_run(scenario: Scenario, since: int, estimator: str) -> Iterator[BlockRecord]:
    """In one process: agents that know nothing take the place of the others before block ``since``."""
    for truth, outboxes in steps(scenario, anew={since: msgspec.structs.replace(scenario, estimator=estimator)}):
        yield BlockRecord(truth, {name: out.estimate for name, out in outboxes.items() if out.estimate is not None})


def test_robots_begin_anew_with_another_estimator_in_mid_run(start: Callable[..., Run], tmp_path: Path) -> None:
    target = tmp_path / "report.json"
    run = start("--duration", "10000", "--change", "t=9999,mass=1", "--history", "--json", str(target))
    wait_until(lambda: "3 converged" in run.text, "the first estimator to find out")

    status, text = run.ask("use", "best")
    assert status == 1
    assert "refused: this run has no estimator 'best'; there are: efficient, fan2017" in text
    assert run.ask("use", "efficient")[0] == 1
    assert run.ask("use") == (0, "the robots use efficient; available: efficient, fan2017\n")
    status, text = run.ask("use", "fan2017")
    assert status == 0, text
    assert run.ask("use") == (0, "the robots use fan2017; available: efficient, fan2017\n")
    wait_until(lambda: run.text.count("starts again") == 3, "all robots to say so")
    wait_until(lambda: "; mass" in run.text.rpartition("starts again")[2], "an estimate by the other estimator")
    assert run.ask("stop")[0] == 0
    assert run.wait() in (0, 3), run.text

    told = json.loads(target.read_text())
    assert told["estimator"] == "fan2017"
    (change,) = told["estimator_changes"]
    assert change["estimator"] == "fan2017"
    since = change["since_s"]
    said = re.findall(r"(r\d): uses the estimator 'fan2017' from (\d+\.\d\d) s on, and starts again", run.words)
    assert sorted(said) == [(name, f"{since:.2f}") for name in ("r1", "r2", "r3")]
    assert f"At {since:g} s all robots started again with the estimator fan2017." in run.words

    scenario = msgspec.structs.replace(load_scenario("ring3"), load_changes=(), duration=told["duration_s"])
    again = in_one_process(scenario, changing_run(scenario, round(since / scenario.block_duration), "fan2017"))
    for key in ("robots", "history", "consensus", "estimator_changes"):
        assert told[key] == again[key], key


def test_an_agent_that_comes_back_uses_what_the_others_use(tmp_path: Path) -> None:
    def begun(team: Team, name: str) -> int:
        return team.log(name).count("uses the estimator 'fan2017'")

    with running_team(small_scenario(3), tmp_path, "realtime") as team:
        team.wait_for_block(10)
        assert team.ask(EstimatorRequest(estimator="fan2017")).estimator == "fan2017"
        wait_until(lambda: all(begun(team, name) == 1 for name in team.plan.agents), "all agents to begin anew")
        team.kill("r2")
        team.restart("r2")
        wait_until(lambda: begun(team, "r2") == 2, "the one that is back to do so, too")
        assert [begun(team, name) for name in ("r1", "r3")] == [1, 1]
