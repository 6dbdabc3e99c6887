"""Processes that are forked are what they would be if each had been started from scratch."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from coheft.app.run.fork_server import Forked, ForkServer, can_fork
from coheft.app.run.processes import Processes
from coheft.wire.messages.requests import StatusRequest
from tests.waiting import LIMIT, wait_until

pytestmark = pytest.mark.skipif(not can_fork(), reason="processes are not forked here")

PART = """
import os, sys
print("imported by", os.getpid(), file=open("imports", "a"))

def main():
    print("I am", os.getpid(), "of session", os.getsid(0), flush=True)
    exec(sys.stdin.readline())
    sys.stdin.read()
"""


@pytest.fixture
def fork_server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ForkServer]:
    """One that can fork ``part``."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "part.py").write_text(PART)
    fork_server = ForkServer(["part"], os.environ)
    yield fork_server
    fork_server.close()


def started(fork_server: ForkServer, name: str, told: str) -> Forked:
    """A process that does what it is told, then waits for the end of its stdin."""
    with Path(f"{name}.log").open("ab") as log:
        process = fork_server.start(name, "part", log.fileno())
    assert process is not None
    process.stdin.write(f"{told}\n".encode())
    process.stdin.flush()
    return process


def test_modules_are_imported_once_and_each_process_has_its_own_session_log_and_name(fork_server: ForkServer) -> None:
    processes = {name: started(fork_server, name, "pass") for name in ("r1", "r2")}
    assert len(Path("imports").read_text().splitlines()) == 1
    for name, process in processes.items():
        wait_until(lambda name=name: "session" in Path(f"{name}.log").read_text(), "its words")  # type: ignore[misc]
        assert Path(f"{name}.log").read_text() == f"I am {process.pid} of session {process.pid}\n"
        assert Path(f"/proc/{process.pid}/comm").read_text() == f"{name}\n"
        assert process.poll() is None
        process.stdin.close()
    assert [process.wait(LIMIT) for process in processes.values()] == [0, 0]


def test_how_each_ends_is_told(fork_server: ForkServer) -> None:
    ways = {"sys.exit(3)": 3, "raise ValueError('this is why')": 1, "os.kill(os.getpid(), 9)": -9, "os._exit(4)": 4}
    for told, status in ways.items():
        process = started(fork_server, "r1", told)
        assert process.wait(LIMIT) == status
        process.stdin.close()
    assert "ValueError: this is why" in Path("r1.log").read_text()
    process = started(fork_server, "r1", "pass")
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(0.01)
    process.terminate()
    assert process.wait(LIMIT) == -signal.SIGTERM
    process.kill()  # which has nothing to do
    process.stdin.close()


def test_processes_end_with_a_fork_server_that_is_killed_and_others_are_started_from_scratch(
    fork_server: ForkServer, tmp_path: Path
) -> None:
    (tmp_path / "part.py").write_text(f"{PART}\nif __name__ == '__main__':\n    main()\n")
    with Processes(tmp_path, fork_server) as processes:
        child = processes.start("r1", "part", StatusRequest())
        assert isinstance(child.process, Forked)
        wait_until(lambda: len(child.lines) == 1, "its words")
        assert fork_server._process is not None
        os.kill(fork_server._process.pid, signal.SIGKILL)
        assert child.process.wait(LIMIT) == -signal.SIGKILL
        processes.start_again(child)
        (again,) = processes.children
        assert isinstance(again.process, subprocess.Popen)
        wait_until(lambda: len(again.lines) == 2, "its words")


ASKER = """
import os, sys
from coheft.app.run.fork_server import ForkServer
fork_server = ForkServer(["part"], os.environ)
process = fork_server.start("r1", "part", 2)
print(process.pid, fork_server._process.pid, flush=True)
sys.stdin.read()
"""


def test_none_is_left_when_whoever_asked_for_them_is_killed(fork_server: ForkServer) -> None:
    command = [sys.executable, "-c", ASKER]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as asker:
        assert asker.stdout is not None
        pids = list(map(int, asker.stdout.readline().split()))
        asker.kill()
    wait_until(lambda: not any(map(_goes_on, pids)), "their ends")


def test_who_changes_their_mind_does_not_wait_for_modules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """For instance with Ctrl-C right after the start."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "slow.py").write_text("open('begun', 'w')\nimport time\ntime.sleep(60)")
    fork_server = ForkServer(["slow"], os.environ)
    wait_until((tmp_path / "begun").exists, "the import")
    began = time.monotonic()
    fork_server.close()
    assert time.monotonic() - began < 30.0  # the import takes a minute


def test_ctrl_c_while_it_is_started_leaves_no_words(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(subprocess, "Popen", interrupted)
    with pytest.raises(KeyboardInterrupt):
        ForkServer(["part"], os.environ)
    gc.collect()  # which makes errors of finalizers failures of this test


def _goes_on(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False
