"""``coheft watch`` in a process of its own, or in this one, on runs of real processes."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import IO

import pytest

from coheft.app.results.record import Record
from coheft.app.run import launch
from coheft.app.run.folder import find_run
from coheft.app.terminal.screen import Display
from coheft.errors import LinkError
from tests.integration.command_line import Run
from tests.waiting import LIMIT, wait_until

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals as on POSIX")


@contextmanager
def watching(run: Run) -> Iterator[tuple[subprocess.Popen[str], IO[str]]]:
    """Somebody who watches a run, and has seen it go on; and what comes after."""
    watcher = subprocess.Popen(
        [sys.executable, "-m", "coheft", "watch", "--run", str(run.folder)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert watcher.stdout is not None
    try:
        assert watcher.stdout.readline() == "waiting for the server of the run to answer\n"
        assert re.fullmatch(r"watching ring3, which is at .* of 10000 s\n", watcher.stdout.readline())
        assert any(" s of 10000 s: " in line for line in watcher.stdout)
        yield watcher, watcher.stdout
    finally:
        watcher.kill()
        watcher.wait()
        watcher.stdout.close()


def test_watch_follows_a_run_to_its_end(start: Callable[..., Run]) -> None:
    run = start("--duration", "10000", "--quiet")
    wait_until(lambda: run.ask("resume")[0] == 0, "the server to answer")  # announced before it listens
    with watching(run) as (watcher, lines):
        assert run.ask("stop")[0] == 0
        assert lines.read().splitlines()[-1].startswith("the run has ended at ")
        assert watcher.wait(LIMIT) == 0
    assert run.wait() in (0, 3)
    assert run.text == "", "quiet means quiet"


def test_who_sleeps_while_a_run_ends_learns_that_it_was_not_aborted(start: Callable[..., Run]) -> None:
    """It misses the last words of the server, as a process on a busy machine may: its link is cut after a second."""
    run = start("--realtime", "--duration", "10000", "--quiet")
    wait_until(lambda: run.ask("resume")[0] == 0, "the server to answer")
    with watching(run) as (watcher, lines):
        watcher.send_signal(signal.SIGSTOP)
        try:
            time.sleep(2.0)
            assert run.ask("stop")[0] == 0
            assert run.wait() in (0, 3)
        finally:
            watcher.send_signal(signal.SIGCONT)
        assert lines.read().splitlines()[-1].startswith("the run has ended at ")
        assert watcher.wait(LIMIT) == 0


class Seen(Display):
    """Counts what a display is told."""

    def __init__(self) -> None:
        self.time, self.unanswered = 0.0, 0

    def update(self, record: Record) -> None:
        self.time = record.time

    def note(self, text: str) -> None:
        self.unanswered += text == "the server does not answer"


def test_who_watches_is_patient_with_a_server_that_hangs_for_a_while(
    start: Callable[..., Run], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(launch, "_SILENCE", 0.1)
    run, seen = start("--duration", "10000"), Seen()
    run.wait_until_under_way()
    with ThreadPoolExecutor(1) as threads:
        watcher = threads.submit(launch.watch, run.folder, find_run(run.folder), seen)
        try:
            wait_until(lambda: seen.time, "the run to be seen")
            for _ in range(3):  # in all, it asks more often in vain than it would in a row
                unanswered = seen.unanswered
                os.kill(run.pids["server"], signal.SIGSTOP)
                wait_until(lambda wanted=unanswered + 2: seen.unanswered >= wanted, "two questions in vain")
                heard = seen.time
                os.kill(run.pids["server"], signal.SIGCONT)
                wait_until(lambda before=heard: seen.time > before, "the server to be heard again")
            os.kill(run.pids["server"], signal.SIGSTOP)
            with pytest.raises(LinkError, match="requests in a row: it has ended, or hangs"):
                watcher.result(LIMIT)
        finally:
            os.kill(run.pids["server"], signal.SIGKILL)
    assert run.wait() == 1


@pytest.mark.parametrize("how", ["the run is told to end", "the server is killed"])
def test_who_watches_a_run_that_breaks_off_is_told_so(how: str, start: Callable[..., Run]) -> None:
    run = start("--realtime", "--duration", "10000")
    run.wait_until_under_way()
    with watching(run) as (watcher, lines):
        if how == "the run is told to end":
            os.kill(run.supervisor.pid, signal.SIGTERM)
        else:
            os.kill(run.pids["server"], signal.SIGKILL)
        text = lines.read()
        assert watcher.wait(LIMIT) == 1
        last = text.splitlines()[-1]
        assert re.match(r"coheft: the run was aborted(: its server ended after| at) [0-9.]+ s$", last), text
        assert "requests in a row" not in text
    run.wait()
