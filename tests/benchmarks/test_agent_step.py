"""Agents that are timed take the steps that they take in a real run, and the command tells what it should.

No test here depends on how fast anything is.
"""

from __future__ import annotations

import json
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from benchmarks import agent_step
from benchmarks.agent_step import HERE, simulated
from benchmarks.agent_step_team import NONE, NoMathematics, Turn, WholeTeam, ring
from coheft.agents.agent import ESTIMATORS
from coheft.app.run.inprocess import TeamInProcess, measured
from coheft.errors import CoheftError, UsageError
from coheft.wire.messages.codec import encode

BLOCKS = 12


def test_teams_measure_and_say_what_they_do_in_a_run(tmp_path: Path) -> None:
    scenario = ring(3)
    blocks, whole, run = simulated(scenario), WholeTeam(scenario, is_counting=True), TeamInProcess(scenario)
    for first in (0, BLOCKS):
        samples = list(islice(blocks, BLOCKS))
        np.save(tmp_path / "samples.npy", samples)
        took = whole.take(Turn(str(tmp_path / "samples.npy"), first))
        sizes = 0
        for mine in samples:
            result = run.measure()
            assert np.array_equal(mine, [result.measurements[name].samples for name in run.graph])
            outboxes = run.answer(measured(result), run.received())
            sizes += sum(len(encode(outbox.message, "")) for outbox in outboxes.values())
        assert took.sizes == sizes
        assert len(took.seconds) == len(took.knows_poses) == BLOCKS
        assert took.calls > 0
        assert took.c_calls > 0


def test_without_mathematics_nothing_is_known(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(ESTIMATORS, NONE, NoMathematics)
    scenario = replace(ring(3), estimator=NONE)
    np.save(tmp_path / "samples.npy", list(islice(simulated(scenario), BLOCKS)))
    took = WholeTeam(scenario, is_counting=False).take(Turn(str(tmp_path / "samples.npy"), 0))
    assert not any(took.knows_poses)
    assert took.calls == took.c_calls == 0


def test_in_larger_rings_each_holds_as_much() -> None:
    shipped, larger = ring(24), ring(96)
    assert larger.robot_count == 96
    assert [box.mass for box in larger.payload.boxes] == [4.0 * box.mass for box in shipped.payload.boxes]
    assert larger.payload.boxes[0].size == (4.0, 2.8, 0.06)
    next(simulated(larger))  # arms can hold it


def run(**options: Any) -> None:
    """The command, with a small team."""
    agent_step.main(**{"teams": "3", "seconds": 0.3, **options})


@pytest.mark.slow
def test_the_command_tells_of_each_estimator_and_of_another_checkout(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "step.json"
    run(json=path, against=HERE)
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
def test_an_estimator_that_there_is_not_is_named(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(CoheftError, match="agents with the estimator bogus ended"):
        run(estimators="bogus")
    assert "no estimator 'bogus'" in capfd.readouterr().err


@pytest.mark.parametrize("wrong", [{"teams": "1"}, {"teams": "six"}, {"seconds": 0.0}, {"against": Path("/nowhere")}])
def test_what_cannot_be_measured_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(UsageError):
        run(**wrong)
