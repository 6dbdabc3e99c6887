"""Recordings of whole runs: real processes, three mocobots that find out online what they carry."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import msgspec
import numpy as np

from coheft.app.mocobots.record import record
from coheft.wire.data.file import read_recording
from coheft.wire.scenario.file import load_scenario

from .command_line import Run


def test_data_that_cannot_be_written_do_not_take_the_report_with_them(tmp_path: Path) -> None:
    place, report = tmp_path / "place", tmp_path / "report.json"
    place.mkdir()
    asked = ("--json", str(report), "--save-data", str(place / "run.npz"))
    run = Run(tmp_path / "logs", "ring3", "--duration", "10000", *asked)
    try:
        run.wait_for_results()
        assert "which requires that all robots hold the payload" in run.ask("release", "r1")[1]
        place.rmdir()
        assert run.ask("stop")[0] == 0
        assert run.wait() == 1
    finally:
        run.end()
    assert "no data file was written" in run.words
    assert json.loads(report.read_text())["scenario"] == "ring3"


def test_a_run_of_mocobots_converges_and_records_the_same_as_one_process(tmp_path: Path) -> None:
    report, data = tmp_path / "report.json", tmp_path / "run.npz"
    command = [sys.executable, "-m", "coheft", "run", "mocobot_b", "--duration", "24", "--quiet"]
    run = subprocess.run(
        [*command, "--json", str(report), "--save-data", str(data), "--logs", str(tmp_path / "logs")],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    for robot in json.loads(report.read_text())["robots"].values():
        assert robot["converged"]
        assert abs(robot["mass"]["estimate"] - 11.672) < 0.1
    saved = read_recording(data)
    same = record(msgspec.structs.replace(load_scenario("mocobot_b"), duration=24.0))
    assert saved.names == same.names == ("r1", "r2", "r3")
    for name in saved.names:
        for channel in ("time", "pose", "wrench"):
            np.testing.assert_array_equal(getattr(saved.robots[name], channel), getattr(same.robots[name], channel))
        assert saved.robots[name].twist is None
    assert saved.truth is not None
    load = saved.truth.load_between(0.0, 24.0)
    assert load is not None
    assert load.mass == 11.672
