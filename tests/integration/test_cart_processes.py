"""Pushers in processes of their own: the same numbers as in one process, and no one is left behind."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from coheft.app.cart.inprocess import run_in_process
from coheft.app.cart.launch import run_in_processes
from coheft.app.cart.table_one import table_one
from coheft.app.cli.base import EXIT_NOT_CONVERGED
from coheft.app.cli.main import run_command_line
from coheft.wire.cart.scenario import CartScenario


@pytest.mark.parametrize("pushers", [1, 3])
def test_processes_come_to_the_same_numbers(pushers: int, tmp_path: Path) -> None:
    scenario = structs.replace(table_one(6, pushers=pushers), duration=3.0)
    problems: list[str] = []
    found = run_in_processes(scenario, lambda _: tmp_path, problems.append)
    expected = run_in_process(scenario)
    assert problems == []
    np.testing.assert_array_equal([truth.motion for truth in found.truths], [truth.motion for truth in expected.truths])
    for name, estimates in expected.estimates.items():
        told = {estimate.block: estimate for estimate in found.estimates[name]}
        last = estimates[-1]
        assert told[last.block].cart == last.cart
        assert told[last.block].members == pushers
        np.testing.assert_array_equal(told[last.block].covariance, last.covariance)


def test_the_command_runs_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, own_state_folder: None) -> None:
    def begun(test: int, **options: object) -> CartScenario:
        return structs.replace(table_one(test, **options), duration=2.0)

    monkeypatch.setattr("coheft.app.cart.table_one.table_one", begun)
    monkeypatch.setattr("coheft.app.cart.judge.SETTLED", 1.0)
    report = tmp_path / "report.json"
    arguments = ["cart", "--test", "1", "--pushers", "2", "--processes", "--quiet", "--json", str(report)]
    assert run_command_line(arguments) == EXIT_NOT_CONVERGED  # two seconds are too few
    learned, fixed = json.loads(report.read_text())["reports"]
    assert (learned["pushers"], learned["learns"], fixed["learns"]) == (2, True, False)
    assert len(list((tmp_path / "state").rglob("p2.log"))) == 1
