"""Whole runs from the command line: real processes, real links."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from coheft.app.recording.reader import read_recording
from coheft.app.run.ctrl_c import SENTENCE
from coheft.app.run.folder import RUN_FILE
from tests.integration.command_line import Run
from tests.waiting import LIMIT, wait_until

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals as on POSIX")


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What a run of 12 s with a load change at 6 s reports."""
    folder = tmp_path_factory.mktemp("run")
    report = folder / "report.json"
    run = Run(
        folder / "run", "ring3", "--duration", "12", "--change", "t=6,mass=2,at=0.2,0.1,0.08", "--history",
        "--json", str(report),
    )  # fmt: skip
    try:
        assert run.wait() in (0, 3), run.text
    finally:
        run.end()
    assert "Traceback" not in run.text
    loaded: dict[str, Any] = json.loads(report.read_text())
    loaded["exit"] = run.supervisor.returncode
    loaded["output"] = run.text
    return loaded


@pytest.mark.smoke
def test_three_robots_find_out_what_they_hold(report: dict[str, Any]) -> None:
    assert report["exit"] == 0
    for robot in [*report["robots"].values(), *report["load_changes"][0]["before_change"].values()]:
        assert robot["mass"]["error_pct"] < 3.0
        assert robot["com"]["error_mm"] < 20.0
        assert robot["converged"]


def test_a_run_whose_errors_contradict_what_robots_claim_is_no_success(tmp_path: Path) -> None:
    """``fan2017`` is not told of errors of sensors: it converges, sure of what is not so."""
    run = Run(tmp_path / "run", "ring3", "--estimator", "fan2017", "--duration", "12", "--set",
              "sensors.errors={force_scale=0.05}")  # fmt: skip
    try:
        assert run.wait() == 3, run.text
    finally:
        run.end()
    assert "Note: 'sensors.errors' has force_scale = 0.05 (tolerance 0): sensors are further off than" in run.text
    assert "Further off than they claim: r" in run.text
    assert "All robots converged" not in run.text


def test_the_report_is_complete(report: dict[str, Any]) -> None:
    for key in ("scenario", "seed", "estimator", "processes", "real_time_factor", "messages_per_s"):
        assert report[key]
    assert report["scenario"] == "ring3"
    assert report["duration_s"] == pytest.approx(12.0)
    assert list(report["robots"]) == ["r1", "r2", "r3"]
    for name, robot in report["robots"].items():
        assert set(robot["mass"]) == set(robot["inertia"]) == {"truth", "estimate", "std", "error_pct"}
        assert set(robot["com"]) == {"truth", "estimate", "std", "error_mm"}
        assert set(robot["poses"]) == set(report["robots"]) - {name}
        for pose in robot["poses"].values():
            assert set(pose) == {"rotation_error_deg", "translation_error_mm"}
        assert 0.0 < robot["converged_at_s"] < 12.0
        assert robot["not_observable"] == []
        assert [point["time_s"] for point in report["history"][name]] == pytest.approx([*range(1, 13)])
    (change,) = report["load_changes"]
    assert change["at_s"] == pytest.approx(6.0)
    assert {"truth", "detected_at_s", "recovered_at_s"} <= set(change)
    before = {robot["mass"]["truth"] for robot in change["before_change"].values()}
    assert change["truth"]["mass"] == pytest.approx(before.pop() + 2.0)
    assert 0.0 <= report["consensus"]["force_rel_error"] < 0.2
    assert 0.0 <= report["consensus"]["torque_rel_error"] < 0.2
    assert report["processes"] == 4


def test_the_final_table_can_be_read_in_80_columns(report: dict[str, Any]) -> None:
    text = report["output"]
    for words in ("mass, kg", "centre of mass, mm", "inertia", "own std", "At 6 s the payload changed", "Logs of all"):
        assert words in text
    table = text[text.index("What each robot") : text.index("At 6 s")]
    assert max(len(line) for line in table.splitlines()) <= 80
    assert "\x1b" not in text, "no colours where there is no terminal"


def test_a_run_that_is_too_short_has_not_converged_and_says_so(tmp_path: Path) -> None:
    command = ["run", "ring3", "--duration", "1", "--json", "-", "--logs", str(tmp_path)]
    run = subprocess.run(
        [sys.executable, "-m", "coheft", *command], capture_output=True, text=True, timeout=LIMIT, check=False
    )
    assert run.returncode == 3, run.stderr
    assert "Not converged: r1, r2, r3" in run.stderr
    assert list(json.loads(run.stdout)["robots"]) == ["r1", "r2", "r3"], "standard output is the report alone"
    assert {path.name for path in tmp_path.iterdir()} == {"server.log", "r1.log", "r2.log", "r3.log", "end.json"}


@pytest.mark.parametrize("sign", [signal.SIGTERM, signal.SIGHUP])
def test_a_request_to_end_stops_everything_at_once(
    sign: signal.Signals, start: Callable[..., Run], tmp_path: Path
) -> None:
    """And so does a terminal that is closed. What is not written is said."""
    data = tmp_path / "data.npz"
    before = signal.signal(sign, signal.SIG_DFL)  # tests may have been started by nohup
    run = start("--duration", "10000", "--save-data", str(data))
    signal.signal(sign, before)
    run.wait_until_under_way()
    os.kill(run.supervisor.pid, sign)
    assert run.wait() == 130
    assert run.left() == []
    said = run.text.splitlines()[-1]
    assert said.startswith("stopped at ")
    assert " s: no data file (--save-data) was written; 'coheft stop', or Ctrl-C pressed once, ends a run with" in said
    assert not data.exists()
    assert "Traceback" not in run.text
    assert not (run.folder / RUN_FILE).exists()


def test_ctrl_c_ends_a_run_with_its_results_so_far(start: Callable[..., Run], tmp_path: Path) -> None:
    data, report, recording = tmp_path / "data.npz", tmp_path / "report.json", tmp_path / "run.mcap"
    outputs = ("--save-data", str(data), "--json", str(report), "--record", str(recording))
    run = start("--duration", "10000", *outputs)
    run.wait_for_results()
    os.killpg(run.supervisor.pid, signal.SIGINT)
    assert run.wait() == 130, run.text
    assert run.left() == []
    assert run.text.count(SENTENCE) == 1
    assert "What each robot found out about the payload" in run.text
    assert "Traceback" not in run.text
    found = json.loads(report.read_text())
    assert 5.0 <= found["duration_s"] < 10000.0
    assert all(robot["mass"]["estimate"] for robot in found["robots"].values())
    with np.load(data) as arrays:
        assert arrays["r1/t"][-1] == pytest.approx(found["duration_s"], abs=0.1)
    assert read_recording(recording).news[-1][0] == pytest.approx(found["duration_s"], abs=0.1)
    assert not (run.folder / RUN_FILE).exists()


def test_a_second_ctrl_c_stops_everything_at_once(start: Callable[..., Run], tmp_path: Path) -> None:
    report = tmp_path / "report.json"
    run = start("--duration", "10000", "--json", str(report))
    run.wait_until_under_way()
    os.kill(run.pids["server"], signal.SIGSTOP)  # so that the run does not end too early for this test
    os.kill(run.supervisor.pid, signal.SIGINT)
    wait_until(lambda: SENTENCE in run.text, "the first Ctrl-C to be taken")
    os.kill(run.supervisor.pid, signal.SIGINT)
    assert run.wait() == 130
    assert "no report (--json) was written" in run.text.splitlines()[-1]
    assert "What each robot" not in run.text
    assert not report.exists()
    assert run.left() == []


def test_ctrl_c_ends_a_paused_run_with_its_results(start: Callable[..., Run]) -> None:
    run = start("--duration", "10000", "--secure")
    run.wait_until_under_way()
    assert run.ask("pause")[0] == 0
    os.kill(run.supervisor.pid, signal.SIGINT)
    assert run.wait() == 130
    assert "What each robot found out about the payload" in run.text


@pytest.mark.parametrize("clock", [(), ("--realtime",)])
def test_an_agent_that_is_killed_is_started_again_and_the_run_goes_on(
    clock: tuple[str, ...], start: Callable[..., Run]
) -> None:
    run = start("--duration", "10000", *clock)
    run.wait_until_under_way()
    for time_no in (1, 2):
        before = run.pids["r2"]
        os.kill(before, signal.SIGKILL)
        wait_until(lambda before=before: run.read_pids()["r2"] != before, "another process")
        wait_until(lambda time_no=time_no: run.text.count("r2 is back before block") == time_no, "its return")
    assert "r2 was killed by signal 9; restarted (2 of 3)" in run.words
    assert run.ask("stop")[0] == 0
    assert run.wait() in (0, 3), run.text
    assert run.left() == []
    assert "Traceback" not in run.text


def test_an_agent_that_is_killed_once_too_often_ends_the_run_and_is_named(
    start: Callable[..., Run], tmp_path: Path
) -> None:
    files = ("--json", str(tmp_path / "report.json"), "--save-data", str(tmp_path / "data.npz"))
    run = start("--duration", "10000", "--restarts", "0", *files)
    run.wait_until_under_way()
    os.kill(run.pids["r2"], signal.SIGKILL)
    assert run.wait() == 1
    assert run.left() == []
    assert "r2 was killed by signal 9" in run.words
    assert "r2.log" in run.text
    last, missing = run.text.splitlines()[-2:]
    assert last == "The run is over, because r2 was killed by signal 9."
    assert missing.startswith("That was at ")
    assert missing.endswith(" s: no report (--json) and no data file (--save-data) were written.")
    assert not list(tmp_path.glob("report.json")) + list(tmp_path.glob("data.npz"))
    assert "Traceback" not in run.text


def test_an_agent_that_is_told_to_end_has_failed_and_is_started_again(start: Callable[..., Run]) -> None:
    run = start("--duration", "10000", "--restarts", "1")
    run.wait_until_under_way()
    before = run.pids["r2"]
    os.kill(before, signal.SIGTERM)
    wait_until(lambda: run.read_pids()["r2"] != before, "another process")
    assert "r2 was told to end by SIGTERM; restarted (1 of 1)" in run.words
    wait_until(lambda: "r2 is back before block" in run.text, "its return")
    os.kill(run.pids["r2"], signal.SIGTERM)
    assert run.wait() == 1
    assert run.left() == []
    again = "after it had been restarted 1 time (--restarts)"
    assert run.text.endswith(f"The run is over, because r2 was told to end by SIGTERM {again}.\n")
    assert "Traceback" not in run.text


@pytest.mark.parametrize(
    ("sign", "how"), [(signal.SIGKILL, "was killed by signal 9"), (signal.SIGTERM, "was told to end by SIGTERM")]
)
def test_a_server_that_is_killed_ends_the_run_and_is_named(
    sign: signal.Signals, how: str, start: Callable[..., Run]
) -> None:
    run = start("--duration", "10000")
    run.wait_until_under_way()
    os.kill(run.pids["server"], sign)
    assert run.wait() == 1
    assert run.left() == []
    assert run.text.endswith(f"The run is over, because server {how}.\n")


def test_an_agent_that_is_frozen_when_the_run_ends_is_named(start: Callable[..., Run]) -> None:
    run = start("--realtime", "--duration", "10000")
    run.wait_until_under_way()
    os.kill(run.pids["r2"], signal.SIGSTOP)
    status, text = run.ask("stop")
    assert status == 0, text
    assert run.wait() == 1
    assert "r2 does not end: it may be frozen" in run.words
    assert "r2.log" in run.text
    assert "Traceback" not in run.text
    assert run.left() == []


def test_no_process_outlives_a_killed_supervisor(start: Callable[..., Run]) -> None:
    run = start("--duration", "10000")
    run.wait_until_under_way()
    run.supervisor.kill()
    run.wait()
    wait_until(lambda: run.left() == [], "all processes to notice that their supervisor is gone")


def test_the_parts_can_be_started_by_hand(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "coheft"]
    folder = tmp_path / "configs"
    subprocess.run(
        [*command, "run", "ring3", "--duration", "1", "--write-configs", str(folder)], check=True, capture_output=True
    )
    parts = [
        subprocess.Popen([*command, "server" if path.stem == "server" else "agent", str(path)])
        for path in sorted(folder.glob("*.json"))
        if path.name != RUN_FILE
    ]
    try:
        assert len(parts) == 4
        assert [part.wait(LIMIT) for part in parts] == [0, 0, 0, 0]
    finally:
        for part in parts:
            if part.poll() is None:
                part.terminate()
                part.wait(LIMIT)
