"""Runs whose supervisor, parts or disk stop at a bad moment: what is found is not lost, and what is said is true."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from coheft.app.cli.main import run_command_line
from coheft.app.run.folder import RUN_FILE
from coheft.app.run.observer import ask_run
from coheft.wire.messages.requests import StatusRequest
from tests.integration.command_line import Run
from tests.waiting import LIMIT, wait_until

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals as on POSIX")


def test_time_stands_still_while_the_supervisor_is_stopped(start: Callable[..., Run], tmp_path: Path) -> None:
    """As after Ctrl-Z, and for longer than the run would take."""
    report = tmp_path / "report.json"
    run = start("--duration", "16", "--change", "t=10,mass=2,at=0.2,0.1,0.08", "--json", str(report))
    run.wait_for_results()  # by then the server has heard its supervisor
    log = run.folder / "server.log"
    os.kill(run.supervisor.pid, signal.SIGSTOP)
    try:
        wait_until(lambda: "the run's supervisor is stopped" in log.read_text(), "the server to notice")
        before = ask_run(StatusRequest(), run.folder)
        assert before.state == "paused"
        time.sleep(4.0)
        assert ask_run(StatusRequest(), run.folder).block == before.block
    finally:
        os.kill(run.supervisor.pid, signal.SIGCONT)
    assert run.wait() == 0, run.text
    assert "this process was stopped for" in run.text
    found = json.loads(report.read_text())
    assert all(robot["converged"] for robot in found["robots"].values())
    assert found["load_changes"][0]["detected_at_s"] == pytest.approx(10.0, abs=1.0)


def test_an_operator_can_pause_a_run_whose_supervisor_goes_on_again(start: Callable[..., Run]) -> None:
    """That it stood still because of its supervisor does not make it go on against the operator's word."""
    run = start("--duration", "10000")
    run.wait_for_results()
    log = run.folder / "server.log"
    os.kill(run.supervisor.pid, signal.SIGSTOP)
    try:
        wait_until(lambda: "the run's supervisor is stopped" in log.read_text(), "the server to notice")
        assert run.ask("pause")[0] == 0
    finally:
        os.kill(run.supervisor.pid, signal.SIGCONT)
    time.sleep(2.0)
    assert ask_run(StatusRequest(), run.folder).state == "paused"
    assert run.ask("resume")[0] == 0
    assert run.ask("stop")[0] == 0
    assert run.wait() in (0, 3), run.text


@pytest.mark.usefixtures("own_state_folder")
def test_runs_in_progress_are_listed_and_none_is_stopped(
    start: Callable[..., Run], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command_line(["stop", "--list"]) == 0
    assert capsys.readouterr().out == "no run is in progress\n"
    runs = []
    for duration in ("9000", "10000"):
        runs.append(start("--realtime", "--duration", duration))
        runs[-1].wait_until_under_way()
    assert runs[0].ask("pause")[0] == 0
    assert run_command_line(["stop", "--list"]) == 0
    printed = capsys.readouterr().out
    title, _, newest, oldest, advice, _ = printed.splitlines()
    assert title.strip() == "Runs in progress"
    assert newest.split()[1] == oldest.split()[1] == "ring3"
    assert "of 10000 s" in newest
    assert "of 9000 s, paused" in oldest
    assert advice == "To end one: coheft stop --run RUN"
    assert max(map(len, printed.splitlines()[:5])) <= 80
    assert run_command_line(["stop", "--run", oldest.split()[0]]) == 0
    assert runs[0].wait() in (0, 3)
    assert runs[1].supervisor.poll() is None
    assert runs[1].ask("stop")[0] == 0
    assert runs[1].wait() in (0, 3)


def test_agents_that_are_killed_before_the_clock_starts_are_started_again(start: Callable[..., Run]) -> None:
    run = start("--duration", "5")
    wait_until((run.folder / RUN_FILE).exists, "the processes")
    for name in ("r1", "r2"):
        os.kill(run.read_pids()[name], signal.SIGKILL)
    assert run.wait() == 0, run.text
    assert "r1 was killed by signal 9; restarted (1 of 3)" in run.words
    assert "r2 was killed by signal 9; restarted (1 of 3)" in run.words


def test_before_the_clock_starts_agents_are_started_again_so_often_only(start: Callable[..., Run]) -> None:
    run = start("--duration", "10", "--restarts", "0")
    wait_until((run.folder / RUN_FILE).exists, "the processes")
    os.kill(run.read_pids()["r2"], signal.SIGKILL)
    assert run.wait() == 1
    assert run.text.endswith("The run is over, because r2 was killed by signal 9.\n")


@pytest.mark.parametrize("part", ["r3", "server"])
@pytest.mark.parametrize("sign", [signal.SIGTERM, signal.SIGINT])
def test_a_run_that_is_told_to_end_does_not_wait_long_for_a_part_that_is_frozen(
    part: str, sign: signal.Signals, start: Callable[..., Run], tmp_path: Path
) -> None:
    """After Ctrl-C there are the results of the others, unless it is the server."""
    data = tmp_path / "data.npz"
    run = start("--duration", "10000", "--save-data", str(data))
    run.wait_until_under_way()
    os.kill(run.pids[part], signal.SIGSTOP)
    time.sleep(3.0)  # its links are full by then
    began = time.monotonic()
    os.killpg(run.supervisor.pid, sign)
    assert run.wait() == 130
    took = time.monotonic() - began
    assert run.left() == []
    assert "Traceback" not in run.text
    if sign == signal.SIGTERM:
        assert took < 10.0  # results, which take longer on a busy machine, are not awaited
        assert "What each robot" not in run.text
    elif part == "server":
        assert ": the server does not answer; no data file (--save-data) was written; " in run.text
    else:
        assert "killed, because of no answer within 3 s: r3" in run.text
        assert "What each robot" in run.text
        assert data.exists()


def test_a_report_that_cannot_be_written_does_not_hide_that_the_recording_was_cut(tmp_path: Path) -> None:
    """A limit of the size of files, in blocks of 512 B, is as good as a full disk."""
    pytest.importorskip("matplotlib")
    recording, report = tmp_path / "run.mcap", tmp_path / "report"
    command = f"{sys.executable} -m coheft run ring3 --duration 4 --record {recording} --report {report}"
    done = subprocess.run(
        ["sh", "-c", f"ulimit -f 200; exec {command} --logs {tmp_path / 'logs'}"],
        capture_output=True,
        text=True,
        timeout=3 * LIMIT,  # pictures take long on a busy machine
        check=False,
    )
    assert done.returncode == 1
    assert "cannot write the report into" in done.stderr
    assert f"{recording}: could no longer be written" in done.stderr
    assert "Traceback" not in done.stderr
