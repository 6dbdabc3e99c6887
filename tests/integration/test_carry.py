"""A load is carried by real processes just as in one."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import msgspec

from coheft.app.results.carry_record import CarryRecord
from coheft.app.run.inprocess import run_in_process
from coheft.physics_server.simulation import Simulation
from coheft.wire.scenario.file import CONFIG_FOLDER, load_scenario
from tests.integration.test_same_numbers import received

PATIENCE = 120.0


def test_the_same_way_in_one_process_and_in_many(tmp_path: Path) -> None:
    text = (CONFIG_FOLDER / "ring3.toml").read_text().replace('name = "ring3"', 'name = "carry3"')
    text = text.replace("at = 20.0", "at = 6.0").replace("duration = 35.0", "duration = 8.5")
    file, report = tmp_path / "carry3.toml", tmp_path / "report.json"
    file.write_text(text + "\n[carry]\nstart = 3.0\nramp = 0.5\nfeedforward_at = 4.0\n")
    scenario = load_scenario(file)
    record = CarryRecord(scenario, Simulation(scenario).scene)
    for block in run_in_process(scenario):
        record.add(received(block.truth))
    command = [
        sys.executable,
        "-m",
        "coheft",
        "run",
        str(file),
        "--json",
        str(report),
        "--logs",
        str(tmp_path / "logs"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.returncode in (0, 3), done.stderr
    assert json.loads(report.read_text())["carry"] == json.loads(msgspec.json.encode(record.report()))
    assert "with feed-forward" in done.stdout
    assert "At 6 s the load changed to 7.00 kg" in done.stdout
