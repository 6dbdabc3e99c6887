"""Agents that are timed take the steps that they take in a real run, and the command tells what it should.

No test here depends on how fast anything is.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from benchmarks import agent_step
from benchmarks.agent_step import HERE, Source
from benchmarks.agent_step_team import NONE, NoMathematics, Turn, WholeTeam, ring
from coheft.agents.agent import ESTIMATORS
from coheft.app.run.inprocess import TeamInProcess, measured
from coheft.wire.messages.codec import encode

BLOCKS = 12


def test_teams_measure_and_say_what_they_do_in_a_run(tmp_path: Path) -> None:
    scenario = ring(3)
    source, whole, run = Source(scenario), WholeTeam(scenario, is_counting=True), TeamInProcess(scenario)
    for first in (0, BLOCKS):
        samples = source.take(BLOCKS)
        np.save(tmp_path / "samples.npy", samples)
        took = whole.take(Turn(str(tmp_path / "samples.npy"), first))
        sizes = 0
        for mine in samples:
            result = run.measure()
            assert np.array_equal(mine, [result.measurements[name].samples for name in run.graph])
            outboxes = run.answer(measured(result), run.heard())
            sizes += sum(len(encode(outbox.message, "")) for outbox in outboxes.values())
        assert took.sizes == sizes
        assert len(took.seconds) == len(took.knows_poses) == BLOCKS
        assert took.calls > 0
        assert took.c_calls > 0


def test_without_mathematics_nothing_is_known(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(ESTIMATORS, NONE, NoMathematics)
    scenario = replace(ring(3), estimator=NONE)
    np.save(tmp_path / "samples.npy", Source(scenario).take(BLOCKS))
    took = WholeTeam(scenario, is_counting=False).take(Turn(str(tmp_path / "samples.npy"), 0))
    assert not any(took.knows_poses)
    assert took.calls == took.c_calls == 0


def test_in_larger_rings_each_holds_as_much() -> None:
    shipped, larger = ring(24), ring(96)
    assert larger.robot_count == 96
    assert [box.mass for box in larger.payload.boxes] == [4.0 * box.mass for box in shipped.payload.boxes]
    assert larger.payload.boxes[0].size == (4.0, 2.8, 0.06)
    Source(larger)  # arms can hold it


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> None:
    """The command, with a small team."""
    monkeypatch.setattr(sys, "argv", ["agent_step", "--teams", "3", "--seconds", "0.3", *arguments])
    agent_step.main()


@pytest.mark.slow
def test_the_command_tells_of_each_estimator_and_of_another_checkout(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "step.json"
    run(monkeypatch, "--json", str(path), "--against", str(HERE))
    told = json.loads(path.read_bytes())
    assert told["about"]["against"] == str(HERE)
    efficient, none = told["3"]["efficient"], told["3"][NONE]
    for figure in ("us_per_block", "calls_per_block", "c_calls_per_block", "bytes_per_message", "worst_block_ms"):
        assert none[figure] > 0
        assert efficient["against"][figure] > 0
    assert none["calls_per_block"] < efficient["calls_per_block"]
    assert none["bytes_per_message"] < efficient["bytes_per_message"] == efficient["against"]["bytes_per_message"]
    assert efficient["ratio"]["calls_per_block"] == pytest.approx(1.0, rel=0.01)
    assert efficient["first_valid_us"] is None  # it has only begun
    output = capsys.readouterr()
    assert [line.split()[1] for line in output.out.splitlines()] == ["estimator", "efficient", "efficient,", NONE]
    assert "3 robots, 0.3 of 0.3 s: efficient " in output.err


@pytest.mark.slow
def test_an_estimator_that_there_is_not_is_named(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="agents with the estimator bogus ended"):
        run(monkeypatch, "--estimators", "bogus")
    assert "no estimator 'bogus'" in capfd.readouterr().err


@pytest.mark.parametrize("wrong", [["--teams", "1"], ["--teams", "six"], ["--seconds", "0"], ["--against", "/nowhere"]])
def test_what_cannot_be_measured_is_refused(
    monkeypatch: pytest.MonkeyPatch, wrong: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        run(monkeypatch, *wrong)
    assert "error: " in capsys.readouterr().err
