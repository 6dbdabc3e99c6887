"""Processes that benchmarks start: what ends is told, and none is left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from benchmarks.long_run import Life
from benchmarks.paced_team import paced_team
from benchmarks.raw_team import Sizes, raw_team
from benchmarks.replay import BLOCKS, record
from benchmarks.scenarios import team_scenario
from benchmarks.startup import Run
from coheft.app.run.folder import find_run
from coheft.app.run.plan import make_plan
from coheft.errors import LinkError
from tests.waiting import LIMIT, wait_until

SIZES = Sizes(measurements=100, message=100, reference=100)


def test_the_death_of_the_raw_server_is_told_and_no_process_is_left_behind() -> None:
    with raw_team(make_plan(team_scenario(3)), SIZES) as team:
        assert team.turn(0.1).blocks > 0
        team.processes["server"].kill()
        with pytest.raises(LinkError, match="with status -9"):
            team.turn(0.1)
    assert not any(psutil.pid_exists(process.pid) for process in team.processes.values())


def test_no_raw_process_outlives_whoever_started_it() -> None:
    start = (
        "import sys, time; from tests.integration.test_benchmark_processes import *\n"
        "with raw_team(make_plan(team_scenario(3)), SIZES) as team:\n"
        "    print(*(process.pid for process in team.processes.values()), flush=True)\n"
        "    time.sleep(1000)"
    )
    with subprocess.Popen([sys.executable, "-c", start], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        pids = [int(pid) for pid in parent.stdout.readline().split()]
        parent.kill()
    assert len(pids) == 4
    wait_until(lambda: not any(map(psutil.pid_exists, pids)), "the end of all processes")


def test_bare_agents_say_again_what_real_ones_said(tmp_path: Path) -> None:
    scenario = team_scenario(3)
    files = record(scenario, tmp_path)
    with paced_team(scenario, tmp_path / "floor", files) as team:
        team.run_until(0.5)
        assert team.turn(0.5).blocks > BLOCKS, "they begin anew when all is said"


def test_a_run_that_does_not_begin_is_told(tmp_path: Path) -> None:
    (tmp_path / "server.log").touch()
    with Run(tmp_path) as run, pytest.raises(LinkError, match="never overwritten"):
        run.began()


def test_a_run_that_ends_too_early_is_told(tmp_path: Path) -> None:
    with Run(tmp_path) as run:
        run.began()
        os.kill(find_run(tmp_path).pids["server"], signal.SIGKILL)
        with pytest.raises(LinkError, match="server was killed by signal 9"):
            run.memory(1e6)


def test_a_process_of_a_long_run_is_looked_at_until_it_ends() -> None:
    ours = Life("ours", os.getpid())
    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        ended = Life("ended", process.pid)
        wait_until(lambda: psutil.Process(process.pid).status() == psutil.STATUS_ZOMBIE, "its end, of which none knows")
        ended.sample(0.0)
    ended.sample(1.0)
    ours.sample(1.0)
    assert ours.times == [1.0]
    assert ours.memory[0] > 1e6
    assert ours.files[0] > 2
    assert not ended.times


def test_a_long_run_that_fails_says_so() -> None:
    command = [sys.executable, "-m", "benchmarks.long_run", "--scenario", "nowhere"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT, check=False)
    assert "nowhere" in done.stderr
    assert done.returncode == 2
    assert "exit status 2;" in done.stdout
