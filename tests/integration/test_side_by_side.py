"""Estimators side by side in real processes, and in the recording of their run."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.reader import make_reader

import coheft
from coheft.api.collector import Collector
from coheft.app.recording.reader import read_recording
from coheft.app.results.record import Record
from coheft.app.results.report import build_report
from coheft.app.run_report.of_recording import report_recording
from tests.test_side_by_side import BOTH, SECONDS, assert_same


@pytest.mark.slow
def test_processes_and_their_recording_give_the_numbers_of_one_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, path = tmp_path / "run.json", tmp_path / "run.mcap"
    command = [
        sys.executable, "-m", "coheft", "run", "ring3", "--quiet", "--estimator", BOTH, "--duration", str(SECONDS),
        "--json", str(file), "--record", str(path), "--logs", str(tmp_path / "logs"),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=120.0, check=False)
    assert done.returncode in (0, 3), done.stderr
    expected = coheft.run("ring3", duration=SECONDS, estimator=BOTH)
    recording = read_recording(path)
    collector, record = Collector(), Record(recording.begin.scene, SECONDS, BOTH)
    collector.begin(recording.begin)
    for _, news in recording.news:
        collector.receive(news)
        record.receive(news)
    report = build_report(expected.scenario, record, real_time_factor=1.0)
    replayed = collector.result(expected.scenario, report)
    for found, alone in ((replayed, expected), (replayed.beside["fan2017"], expected.beside["fan2017"])):
        for name, robot in alone.robots.items():
            assert_same(found.robots[name], robot)
    told = json.loads(file.read_text())
    for found, shown in ((report, told), (report.beside["fan2017"], told["beside"]["fan2017"])):
        masses = {name: robot.mass.estimate for name, robot in found.robots.items()}
        assert masses == {name: robot["mass"]["estimate"] for name, robot in shown["robots"].items()}
    pytest.importorskip("matplotlib")
    monkeypatch.setattr("coheft.app.run_report.folder.pictures_of", lambda series, report: [])  # takes most of the time
    page = report_recording(path, tmp_path / "page").read_text(encoding="utf-8")
    assert "estimator efficient, beside it fan2017" in page
    assert "<td>fan2017</td>" in page
    assert ">bound</th>" in page
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    topics = {channel.topic for channel in summary.channels.values()}
    assert {"/r1/error/payload", "/fan2017/r1/error/payload", "/fan2017/r1/three_sigma/payload"} <= topics
