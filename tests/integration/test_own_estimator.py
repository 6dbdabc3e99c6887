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

from coheft.app.run.inprocess import run_in_process
from coheft.errors import SimulationError
from coheft.wire.messages.structs import Estimate
from coheft.wire.scenario.file import load_scenario
from tests.own_packages import EXAMPLE, install_example, write_package

ROOT = Path(__file__).parents[2]
SCENARIO = EXAMPLE / "scale6.toml"
BURST = """
import numpy as np
class Burst:
    def __init__(self, config):
        self.is_bad, self.block = config.name == "r2", config.block
    def reference(self, block):
        return np.full((self.block, 12), np.nan if self.is_bad and 10 <= block < 20 else 0.0)
"""
TALKATIVE = """
import numpy as np
from coheft.agents.estimator import Belief
class Talkative:
    def __init__(self, config, gossip):
        pass
    def step(self, index, own, inbox):
        return {"all": np.zeros(40000)}
    def fits(self, channels):
        return True
    def belief(self):
        return Belief("poses", False, None, {})
    def doubts(self):
        return ()
"""
FAULTY = """
import os, sys
from pathlib import Path
from coheft.agents.estimator import Belief
class Faulty:
    def __init__(self, config, gossip):
        self.name, self.settings = config.name, config.estimator_settings
    def step(self, index, own, inbox):
        if self.name == "r2" and index > 20:
            crash = Path(self.settings["crash"])
            if crash.exists():
                crash.unlink()
                print("out of memory, perhaps", file=sys.stderr, flush=True)
                os._exit(7)
            return {"all": inbox["r9"]["all"]}
        return {}
    def fits(self, channels):
        return True
    def belief(self):
        return Belief("poses", False, None, {})
    def doubts(self):
        return ()
"""


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
    assert re.search(r"found 'scales', expected one of: efficient, fan2017, .*\bscale\b", unknown.stderr)
    write_package(tmp_path, "bad", "import no_such_module", estimators="bad = bad:Bad")
    broken = coheft(tmp_path, tmp_path, "run", "ring3", "--estimator", "bad", "--duration", "1")
    assert broken.returncode == 1
    assert "the estimator 'bad', bad:Bad of bad, cannot be imported: ModuleNotFoundError" in broken.stderr
    assert "Traceback" not in broken.stderr


def test_a_faulty_one_ends_the_run_at_once_with_the_place_and_is_not_started_again(tmp_path: Path) -> None:
    write_package(tmp_path, "faulty", FAULTY, estimators="faulty = faulty:Faulty")
    crash = tmp_path / "crash"
    file = tmp_path / "faulty.toml"
    text = (ROOT / "configs" / "ring3.toml").read_text()
    file.write_text(f'estimator = "faulty"\nsettings.faulty.crash = "{crash}"\n{text}')
    crash.touch()
    done = coheft(tmp_path, tmp_path, "run", str(file), "--duration", "1000")
    said = " ".join((done.stdout + done.stderr).split())
    assert done.returncode == 1, said
    # That it crashed may have had other reasons; that it raised has not.
    assert "r2 ended with status 7: out of memory, perhaps; restarted (1 of 3)" in said
    assert said.count("restarted (") == 1
    assert re.search(r"the estimator 'faulty' of r2 at block \d+ \(\d+\.\d\d s\): step raised KeyError: 'r9' ", said)
    assert f"({tmp_path / 'faulty.py'}, line 15)" in said
    assert "The run is over, because r2 ended with status 2" in said
    assert "Traceback" not in said


def test_one_that_says_more_than_neighbours_take_is_told_so_before_it_says_it(tmp_path: Path) -> None:
    write_package(tmp_path, "talkative", TALKATIVE, estimators="talkative = talkative:Talkative")
    done = coheft(tmp_path, tmp_path, "run", "ring3", "--estimator", "talkative")
    assert done.returncode == 1, done.stderr
    place = f"step ({tmp_path / 'talkative.py'}, line 7)"
    assert f"{place} returned an unusable value: its arrays take 320.0 kB, expected at most 184.0 kB" in done.stderr


def test_a_motion_that_is_not_finite_is_told_with_its_robot_and_in_one_process_ends_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_package(tmp_path, "burst", BURST, motions="burst = burst:Burst")
    monkeypatch.syspath_prepend(tmp_path)
    file = tmp_path / "burst.toml"
    file.write_text('motion.own = "burst"\n' + (ROOT / "configs" / "ring3.toml").read_text())
    done = coheft(tmp_path, tmp_path, "run", str(file), "--duration", "1", "--quiet")
    assert done.returncode == 3, done.stderr  # who stands still learns nothing
    said = (tmp_path / "logs" / "server.log").read_text().splitlines()
    assert [line for line in said if "refused" in line] == [
        "refused from r2: the reference of block 10 is not finite: its arm holds still until it gets a reference "
        "that it can follow"
    ]
    scenario = msgspec.structs.replace(load_scenario(file), duration=1.0, load_changes=())
    with pytest.raises(SimulationError, match=r"at 0\.200 s references of r2 contain numbers that are not finite"):
        list(run_in_process(scenario))
