"""Estimators for measurements of one's own: the same as in a run, without simulation and network."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest

import coheft
from coheft.app.run.inprocess import run_in_process
from coheft.app.study.samples import simulate
from coheft.errors import UsageError
from coheft.estimators import Team, samples_of

DURATION = 2.0


@pytest.fixture(scope="module")
def scenario() -> coheft.Scenario:
    return msgspec.structs.replace(coheft.load_scenario("ring3"), duration=DURATION)


@pytest.fixture(scope="module")
def samples(scenario: coheft.Scenario) -> dict[str, np.ndarray]:
    rows = simulate(scenario).samples
    return {name: rows[:, k] for k, name in enumerate(scenario.robot_names)}


def make_team(scenario: coheft.Scenario) -> Team:
    return Team(scenario.robot_names, sensors=scenario.sensors, converged=scenario.converged)


def test_it_says_what_the_agents_of_a_run_say(scenario, samples):
    team = make_team(scenario)
    team.add(samples)
    last = [record.estimates for record in run_in_process(scenario) if record.estimates][-1]
    for name, estimate in last.items():
        assert team.estimates[name].payload.mass == estimate.payload.mass
        np.testing.assert_array_equal(team.estimates[name].payload.covariance, estimate.payload.covariance)


def test_recordings_become_samples(scenario: coheft.Scenario, samples: dict[str, np.ndarray], tmp_path: Path) -> None:
    arrays = {}
    for name, rows in samples.items():
        w, v, a, force, torque = np.split(rows, 5, axis=1)
        arrays |= {
            f"{name}/t": np.arange(len(rows)) / scenario.sensors.rate,
            f"{name}/twist": np.hstack([w, v]),
            f"{name}/acceleration": a,
            f"{name}/wrench": np.hstack([torque, force]),
        }
    np.savez(tmp_path / "run.npz", **arrays)
    for recording in (arrays, tmp_path / "run.npz"):
        found = samples_of(recording)
        assert list(found) == list(samples)
        for name, rows in samples.items():
            np.testing.assert_array_equal(found[name], rows)


def test_samples_may_come_one_by_one(scenario, samples):
    whole, single = make_team(scenario), make_team(scenario)
    count = 7 * scenario.sensors.block + 3
    whole.add({name: rows[:count] for name, rows in samples.items()})
    for k in range(count):
        single.add({name: rows[k] for name, rows in samples.items()})
    assert [e.block for e in single.estimates.values()] == [e.block for e in whole.estimates.values()]


def test_a_robot_without_measurements_is_named(scenario, samples):
    team = make_team(scenario)
    team.add(samples | {"r2": np.full_like(samples["r2"], np.nan)})
    assert any("own sensors" in reason for reason in team.estimates["r2"].reasons)
    assert not any("own sensors" in reason for reason in team.estimates["r1"].reasons)


def test_what_does_not_fit_is_refused():
    team = Team(["left", "right"], sensors={"rate": 100, "block": 5, "tolerance": {}})
    with pytest.raises(UsageError, match="found robots left, expected left, right"):
        team.add({"left": np.zeros(15)})
    with pytest.raises(UsageError, match=r"left \(2, 14\), expected \(2, 15\)"):
        team.add({"left": np.zeros((2, 14)), "right": np.zeros((2, 15))})
    with pytest.raises(UsageError, match="at least two different names"):
        Team(["left", "left"])
    with pytest.raises(UsageError, match=r"sensors: key 'rate': expected one of 100"):
        Team(["left", "right"], sensors={"rate": 300})


def test_it_loads_neither_network_nor_simulation():
    code = (
        "import sys, coheft; coheft.estimators.Team(['a', 'b']); print(sorted({'zenoh', 'mujoco'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
