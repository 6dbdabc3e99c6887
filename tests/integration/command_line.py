"""``coheft run`` as somebody starts it, and other commands on that run."""

from __future__ import annotations

import io
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import msgspec

from coheft.app.cli.main import run_command_line
from coheft.app.run.folder import RUN_FILE, RunFile
from coheft.app.run.observer import ask_run
from coheft.errors import CoheftError
from coheft.wire.messages.requests import StatusRequest
from tests.waiting import LIMIT, wait_until


def alive(pid: int) -> bool:
    """Whether a process runs; one that waits to be reaped does not."""
    state = subprocess.run(["ps", "-o", "stat=", "-p", str(pid)], capture_output=True, text=True, check=False).stdout
    return bool(state.strip()) and not state.startswith("Z")


class Run:
    """``coheft run`` in a process group of its own, as a terminal would start it."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.folder = folder
        self.output = folder.with_suffix(".out")
        with self.output.open("wb") as output:
            self.supervisor = subprocess.Popen(
                [sys.executable, "-m", "coheft", "run", *arguments, "--logs", str(folder)],
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        self.pids: dict[str, int] = {}

    def wait_until_under_way(self) -> None:
        """Wait until blocks go by, and learn who is who."""
        self._wait_until(self._has_begun)

    def wait_for_results(self) -> None:
        """Wait for the first line about simulated time, after 5 s of it, and learn who is who."""
        self._wait_until(lambda: " s of " in self.text)

    def _has_begun(self) -> bool:
        if not (self.folder / RUN_FILE).exists():
            return False
        try:
            return ask_run(StatusRequest(), self.folder).block > 0
        except CoheftError:  # it does not answer yet
            return False

    def _wait_until(self, condition: Callable[[], bool]) -> None:
        wait_until(lambda: self.supervisor.poll() is not None or condition(), "the run to be under way")
        assert self.supervisor.poll() is None, self.text
        self.read_pids()
        assert all(alive(pid) for pid in self.pids.values())

    def read_pids(self) -> dict[str, int]:
        """Who is who now."""
        self.pids = msgspec.json.decode((self.folder / RUN_FILE).read_bytes(), type=RunFile).pids
        return self.pids

    def wait(self) -> int:
        return self.supervisor.wait(LIMIT)

    @property
    def text(self) -> str:
        return self.output.read_text()

    @property
    def words(self) -> str:
        return " ".join(self.text.split())

    def ask(self, *arguments: str) -> tuple[int, str]:
        """Another command on this run, carried out in this process: its exit status and all its output."""
        output = io.StringIO()
        with redirect_stdout(output), redirect_stderr(output):
            status = run_command_line([*arguments, "--run", str(self.folder)])
        return status, output.getvalue()

    def left(self) -> list[str]:
        return [name for name, pid in self.pids.items() if alive(pid)]

    def end(self) -> None:
        if self.supervisor.poll() is None:
            self.supervisor.terminate()
            self.supervisor.wait(LIMIT)
        for pid in self.pids.values():  # none, unless what is tested is broken
            if alive(pid):
                os.kill(pid, signal.SIGKILL)
