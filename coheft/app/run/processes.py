"""Child processes that end when their supervisor does.

Each child reads its configuration as one line of JSON from stdin, which then stays open: the child ends when stdin is
closed. The system closes it even if the supervisor is killed.
"""

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Self

import msgspec

from coheft.app.run.fork_server import Forked, ForkServer, can_fork
from coheft.errors import CoheftError, file_errors, one_line
from coheft.wire.process.supervised import KILLED_BY, ONE_THREAD, TERMINATED, UNUSABLE

# Nothing is rendered, so MuJoCo need not load a graphics library.
ENVIRONMENT = {**ONE_THREAD, "MUJOCO_GL": "disable"}
FORKED = ("coheft.agents.process.main", "coheft.physics_server.server")
"""Modules that a fork server can start for a run."""
_EXIT_TIMEOUT = 1.0
_TERMINATE_TIMEOUT = 0.4
_FURTHER_FAILURES = 0.5
"""Time after the first failure in which further failures are awaited, which may include the cause [s]."""
_LOG_LINES = 12
_BY_HAND = {
    "scenario": ("coheft.physics_server.server", "a server's configuration: start it with 'coheft server'"),
    "agent": ("coheft.agents.process.main", "an agent's configuration: start it with 'coheft agent'"),
    "agents": ("", "not a configuration; it tells other commands the run's addresses: start the parts beside it"),
}
"""By a key that only this file has: the module that uses the file, which checks the rest, and a description."""


class ProcessError(CoheftError):
    """A process of the run ended before the run."""


@dataclass(frozen=True)
class Child:
    """One process of a run; its own output begins at ``log_start`` [B] of the log."""

    name: str
    module: str
    config: bytes
    log: Path
    process: subprocess.Popen[bytes] | Forked
    log_start: int
    restarts: int = 0

    @property
    def status(self) -> int:
        """Exit status, or minus the number of a signal."""
        assert self.process.returncode is not None
        return self.process.returncode

    @property
    def how(self) -> str:
        """Description of how it ended."""
        code = self.status
        if code == TERMINATED:
            return "was told to end by SIGTERM"
        return f"was killed by signal {-code}" if code < 0 else f"ended with status {code}"

    @property
    def how_and_why(self) -> str:
        """Description of how it ended, with the last line of its output if it ended by itself."""
        if self.status < 0 or self.status == TERMINATED:
            return self.how
        words = ""
        with suppress(FileNotFoundError):
            words = self.log.read_bytes()[self.log_start :].decode(errors="replace").strip()
        return f"{self.how}: {one_line(words.splitlines()[-1])}" if words else f"{self.how}, and did not say why"

    @property
    def lines(self) -> list[str]:
        """The lines of its log; empty if the file was removed."""
        with suppress(FileNotFoundError):
            return self.log.read_text(errors="replace").splitlines()
        return []


class Processes:
    """The processes of a run. Leaving the context stops all that are left, within two seconds.

    The fork server, which ends with the context, forks those whose modules it has imported; the others start from
    scratch.
    """

    def __init__(self, folder: Path, fork_server: ForkServer | None = None) -> None:
        self.folder = folder
        self.children: list[Child] = []
        self._fork_server = fork_server

    def start(self, name: str, module: str, config: msgspec.Struct) -> Child:
        """Start ``python -m module`` with its configuration; its output goes to ``<name>.log``."""
        log = self.folder / f"{name}.log"
        log.unlink(missing_ok=True)
        line = msgspec.json.encode(config)
        child = Child(name, module, line, log, *self._start(name, module, line, log))
        self.children.append(child)
        return child

    def start_again(self, child: Child) -> None:
        """Restart a process that has ended; its output is appended to its log."""
        _close_stdin(child.process)
        process, log_start = self._start(child.name, child.module, child.config, child.log)
        self.children[self.children.index(child)] = replace(
            child, process=process, restarts=child.restarts + 1, log_start=log_start
        )

    @property
    def pids(self) -> dict[str, int]:
        """Process ids by name."""
        return {child.name: child.process.pid for child in self.children}

    @property
    def failed(self) -> list[Child]:
        """Processes that have ended with a status other than 0."""
        return [child for child in self.children if child.process.poll() not in (None, 0)]

    def check(self, limit: int | None = None) -> None:
        """Raise a ``ProcessError``, with the end of its log, if a process has failed.

        ``limit`` is the number of restarts, if that is why there was no other.
        """
        if self.failed:
            self._wait(_FURTHER_FAILURES)
            raise _error(self.failed, limit)

    def all_done_but(self, name: str) -> bool:
        """Whether every process except ``name`` has ended."""
        return all(child.process.poll() is not None for child in self.children if child.name != name)

    def ended(self, name: str) -> bool:
        """Whether the process ``name`` has ended."""
        return any(child.process.poll() is not None for child in self.children if child.name == name)

    def wait_for_all_but(self, name: str, seconds: float) -> None:
        """Wait for the end of every other process, or raise a ``ProcessError`` with those that fail or do not end."""
        deadline = time.monotonic() + seconds
        while not self.all_done_but(name):
            self.check()
            if time.monotonic() > deadline:
                raise ProcessError(
                    "\n".join(
                        f"{child.name} does not end: it may be frozen; its log: {child.log}"
                        for child in self._running()
                        if child.name != name
                    )
                )
            time.sleep(0.01)

    def kill_all_but(self, name: str) -> list[str]:
        """Kill every other process that still runs; return their names."""
        left = [child for child in self._running() if child.name != name]
        for child in left:
            child.process.kill()
        return [child.name for child in left]

    def stop(self) -> None:
        """End all processes: close stdin, then send SIGTERM, then SIGKILL."""
        for child in self.children:
            _close_stdin(child.process)
        self._wait(_EXIT_TIMEOUT)
        for child in self._running():
            child.process.terminate()
        self._wait(_TERMINATE_TIMEOUT)
        for child in self._running():
            child.process.kill()
            child.process.wait()
        if self._fork_server is not None:
            self._fork_server.close()

    def _start(self, name: str, module: str, config: bytes, log: Path) -> tuple[subprocess.Popen[bytes] | Forked, int]:
        """Start a process; return it and the offset of its output in the log [B]."""
        log.parent.mkdir(parents=True, exist_ok=True)  # it may have been removed during the run
        with log.open("ab") as output:
            log_start = output.tell()
            process: subprocess.Popen[bytes] | Forked | None = None
            if self._fork_server is not None and module in self._fork_server.modules:
                process = self._fork_server.start(name, module, output.fileno())
            process = process or _spawned(module, output)
        _configure(process, config)
        return process, log_start

    def _running(self) -> list[Child]:
        return [child for child in self.children if child.process.poll() is None]

    def _wait(self, seconds: float) -> None:
        deadline = time.monotonic() + seconds
        while self._running() and time.monotonic() < deadline:
            time.sleep(0.01)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()


def _spawned(module: str, output: IO[bytes] | None = None) -> subprocess.Popen[bytes]:
    """Start ``python -m module``, with its output in a file, or on ours."""
    return subprocess.Popen(
        [sys.executable, "-m", module],
        stdin=subprocess.PIPE,
        stdout=output,
        stderr=output,
        env=_environment(),
        start_new_session=True,  # otherwise Ctrl-C would reach it before its stdin is closed
    )


def _configure(process: subprocess.Popen[bytes] | Forked, config: bytes) -> None:
    assert process.stdin is not None
    with suppress(BrokenPipeError):  # it has already failed, which is reported elsewhere
        process.stdin.write(config + b"\n")
        process.stdin.flush()


def make_fork_server() -> ForkServer | None:
    """Start a process that imports what those of a run need; None on platforms without fork."""
    return ForkServer(FORKED, _environment()) if can_fork() else None


def _environment() -> dict[str, str]:
    """Return the environment of a new process, which imports modules from where this one does.

    Files in the user's current folder, such as queue.py, take the place of modules only if they do so here.
    """
    with suppress(FileNotFoundError):  # the folder was removed
        if {"", os.getcwd()} & set(sys.path):
            return {**os.environ, **ENVIRONMENT}
    return {**os.environ, **ENVIRONMENT, "PYTHONSAFEPATH": "1"}


def _close_stdin(process: subprocess.Popen[bytes] | Forked) -> None:
    if process.stdin is not None:
        with suppress(BrokenPipeError):
            process.stdin.close()


def _error(failed: Sequence[Child], limit: int | None) -> ProcessError:
    """Make an error that names the process that failed first and shows the end of its log.

    If several have failed, most of them failed because one was missing. The cause is the one that was killed by a
    signal, or else the one that cannot use its configuration, or else the one that ended with a traceback.
    """

    def how_unlikely(child: Child) -> tuple[bool, bool, bool]:
        return child.status >= 0, child.status != UNUSABLE, "Traceback" not in "".join(child.lines)

    first = min(failed, key=how_unlikely)
    times = f"{first.restarts} time{'s' * (first.restarts > 1)}"
    again = f" after it had been restarted {times}" if first.restarts else ""
    if first.status == UNUSABLE:
        again = "; restarting it would not help"
    elif 0 < first.restarts == limit:
        again += " (--restarts)"
    tail = "\n".join(f"  {line}" for line in first.lines[-_LOG_LINES:] or ["(it is empty)"])
    others = "".join(f"\nAfter it, {child.name} {child.how}." for child in failed if child is not first)
    return ProcessError(
        f"{first.name} {first.how}; the end of its log, {first.log}:\n{tail}{others}\n"
        f"The run is over, because {first.name} {first.how}{again}."
    )


def read_config(config: Path) -> bytes:
    """Return a configuration as one line of JSON, with absolute file paths, or raise a ``CoheftError``."""
    try:
        with file_errors(CoheftError, f"{config}: cannot be read"):
            found = msgspec.json.decode(config.read_bytes())
    except msgspec.DecodeError as error:
        raise CoheftError(f"{config}: not JSON: {error}") from error
    if isinstance(found, dict) and isinstance(security := found.get("security"), dict):
        found["security"] = {name: str((config.parent / str(path)).resolve()) for name, path in security.items()}
    return msgspec.json.encode(found)


def run_in_foreground(module: str, config: Path) -> int:
    """Run one part of a team until it ends, with its output on ours; return its exit status.

    A configuration that cannot be read, or is for another part, raises a ``CoheftError``.
    """
    line = read_config(config)
    found = msgspec.json.decode(line)
    for key, (part, what) in _BY_HAND.items():
        if part != module and isinstance(found, dict) and key in found:
            raise CoheftError(f"{config} is {what}")
    process = _spawned(module)
    try:
        _configure(process, line)
        code = process.wait()
        return code if code >= 0 else KILLED_BY - code
    finally:
        _close_stdin(process)
        try:
            process.wait(_EXIT_TIMEOUT)
        except subprocess.TimeoutExpired:
            process.kill()
