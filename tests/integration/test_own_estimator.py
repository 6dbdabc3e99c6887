"""The example package of an own estimator and an own motion, installed and run by real processes."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest

from coheft.app.inprocess import run_in_process
from coheft.wire.messages import Estimate
from coheft.wire.scenario_file import load_scenario
from tests.own_packages import EXAMPLE, install_example, write_package

ROOT = Path(__file__).parents[2]
SCENARIO = EXAMPLE / "scale6.toml"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install_example(tmp_path_factory.mktemp("own"))


def coheft(site: Path, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """The command line, where a folder of packages is on the path."""
    return subprocess.run(
        [sys.executable, "-m", "coheft", *arguments, "--logs", str(folder / "logs")],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{site}"},
    )


def test_it_weighs_the_same_in_many_processes_and_in_one(
    site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    report = tmp_path / "report.json"
    done = coheft(site, tmp_path, "run", str(SCENARIO), "--duration", "4", "--quiet", "--json", str(report))
    assert done.returncode == 3, done.stderr  # a scale never knows all
    monkeypatch.syspath_prepend(site)
    scenario = msgspec.structs.replace(load_scenario(SCENARIO), duration=4.0)
    last: dict[str, Estimate] = {}
    for block in run_in_process(scenario):
        last |= block.estimates
    robots = json.loads(report.read_text())["robots"]
    assert len(robots) == 6
    for name, robot in robots.items():
        payload = last[name].payload
        assert payload is not None
        assert robot["mass"]["estimate"] == payload.mass
        assert robot["mass"]["truth"] == 9.0
        assert abs(payload.mass - 9.0) < 5.0 * np.sqrt(payload.covariance[0, 0]) < 0.5
        assert robot["com"]["estimate"] is None


def test_it_notices_another_load_and_never_claims_too_much(site: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(site)
    loads = (msgspec.structs.replace(load_scenario(SCENARIO).load_changes[0], at=3.0),)
    scenario = msgspec.structs.replace(load_scenario(SCENARIO), duration=8.0, load_changes=loads)
    seen = set()
    for block in run_in_process(scenario):
        truth = block.truth.payload.mass
        for estimate in block.estimates.values():
            seen.add(estimate.status)
            if estimate.status == "valid" and not 3.0 < estimate.time < 3.2:  # word of it takes its time
                assert estimate.payload is not None
                assert abs(estimate.payload.mass - truth) < 5.0 * np.sqrt(estimate.payload.covariance[0, 0])
    assert seen == {"starting", "valid", "stale"}


def test_errors_list_it_and_say_why_it_cannot_start(site: Path, tmp_path: Path) -> None:
    unknown = coheft(site, tmp_path, "run", "ring3", "--estimator", "scales")
    assert unknown.returncode == 2
    assert re.search(r"found 'scales', expected one of: efficient, seed, .*\bscale\b", unknown.stderr)
    write_package(tmp_path, "bad", "import no_such_module", estimators="bad = bad:Bad")
    broken = coheft(tmp_path, tmp_path, "run", "ring3", "--estimator", "bad", "--duration", "1")
    assert broken.returncode == 1
    assert "the estimator 'bad', bad:Bad of bad, cannot be imported: ModuleNotFoundError" in broken.stderr
    assert "Traceback" not in broken.stderr
