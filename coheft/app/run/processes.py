"""Child processes that never outlive their supervisor.

Each child gets its configuration as one line of JSON on stdin, which then stays open: its end tells the child to go.
The system closes it even when the supervisor is killed.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any, Self

import msgspec

from coheft.app.run.fork_server import Forked, ForkServer, can_fork
from coheft.errors import CoheftError, one_line
from coheft.wire.process.supervised import KILLED_BY, ONE_THREAD, TERMINATED, UNUSABLE

# No one draws: MuJoCo need not load what it would draw with.
ENVIRONMENT = {**ONE_THREAD, "MUJOCO_GL": "disable"}
FORKED = ("coheft.agents.process.main", "coheft.physics_server.server")
"""What a run is made of."""
_GO_BY_THEMSELVES = 1.0
_GO_WHEN_ASKED = 0.4
_OTHERS_FAIL = 0.5
"""Time after the first failure in which others show theirs, the cause perhaps among them [s]."""
_LOG_LINES = 12
_BY_HAND = {
    "scenario": ("coheft.physics_server.server", "a server's configuration: start it with 'coheft server'"),
    "agent": ("coheft.agents.process.main", "an agent's configuration: start it with 'coheft agent'"),
    "agents": ("", "no configuration, but tells other commands where the run is: start the parts beside it"),
}
"""By a key that no other file of a run's parts has: what runs with it, and what it is."""


class ProcessError(CoheftError):
    """A process of the run ended before the run did."""


@dataclass(frozen=True)
class Child:
    """One process of a run.

    Attributes:
        name: In the run.
        module: What it runs.
        config: What it was told when it started, as JSON.
        log: Where its output goes.
        process: It.
        log_start: Where in the log its own output begins [B].
        restarts: How often it had been started before.
    """

    name: str
    module: str
    config: bytes
    log: Path
    process: subprocess.Popen[bytes] | Forked
    log_start: int
    restarts: int = 0

    @property
    def status(self) -> int:
        """With which it has ended, or minus the number of a signal."""
        assert self.process.returncode is not None
        return self.process.returncode

    @property
    def how(self) -> str:
        """How it ended."""
        code = self.status
        if code == TERMINATED:
            return "was told to end by SIGTERM"
        return f"was killed by signal {-code}" if code < 0 else f"ended with status {code}"

    @property
    def how_and_why(self) -> str:
        """How it ended, with its last words where they tell why: a signal comes from elsewhere."""
        if self.status < 0 or self.status == TERMINATED:
            return self.how
        words = ""
        with suppress(FileNotFoundError):
            words = self.log.read_bytes()[self.log_start :].decode(errors="replace").strip()
        return f"{self.how}: {one_line(words.splitlines()[-1])}" if words else f"{self.how}, and did not say why"

    @property
    def lines(self) -> list[str]:
        """Its log, or what is left of it."""
        with suppress(FileNotFoundError):
            return self.log.read_text(errors="replace").splitlines()
        return []


class Processes:
    """The processes of a run. Leaving the context stops those that are left, within two seconds.

    Args:
        folder: For their logs.
        fork_server: Forks those of its modules; None: all are started from scratch. It ends with the context.
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
        """Start a process that has ended once more; its output is added to its log."""
        _close_stdin(child)
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
        """Processes that have ended with another status than 0."""
        return [child for child in self.children if child.process.poll() not in (None, 0)]

    def check(self, limit: int | None = None) -> None:
        """Check that none has failed.

        Args:
            limit: How often each may be started again, if that may be why one that has failed is not.

        Raises:
            ProcessError: One has; the message names it and shows the end of its log.
        """
        if self.failed:
            self._wait(_OTHERS_FAIL)
            raise _error(self.failed, limit)

    def all_done_but(self, name: str) -> bool:
        """Whether every process but one has ended."""
        return all(child.process.poll() is not None for child in self.children if child.name != name)

    def ended(self, name: str) -> bool:
        """Whether one process has ended."""
        return any(child.process.poll() is not None for child in self.children if child.name == name)

    def wait_for_all_but(self, name: str, seconds: float) -> None:
        """Wait for every process but one to end.

        Raises:
            ProcessError: One has failed, or some go on for longer; the message names them.
        """
        deadline = time.monotonic() + seconds
        while not self.all_done_but(name):
            self.check()
            if time.monotonic() > deadline:
                raise ProcessError(
                    "\n".join(
                        f"{child.name} does not end: it may be frozen; its log: {child.log}"
                        for child in self._left()
                        if child.name != name
                    )
                )
            time.sleep(0.01)

    def stop(self) -> None:
        """End all processes: ask by the end of stdin, then by a signal, then do not ask."""
        for child in self.children:
            _close_stdin(child)
        self._wait(_GO_BY_THEMSELVES)
        for child in self._left():
            child.process.terminate()
        self._wait(_GO_WHEN_ASKED)
        for child in self._left():
            child.process.kill()
            child.process.wait()
        if self._fork_server is not None:
            self._fork_server.close()

    def _start(self, name: str, module: str, config: bytes, log: Path) -> tuple[subprocess.Popen[bytes] | Forked, int]:
        """A new process, and where its output begins in the log [B]."""
        log.parent.mkdir(parents=True, exist_ok=True)  # somebody may have cleaned up while the run goes on
        with log.open("ab") as output:
            log_start = output.tell()
            process: subprocess.Popen[bytes] | Forked | None = None
            if self._fork_server is not None and module in self._fork_server.modules:
                process = self._fork_server.start(name, module, output.fileno())
            process = process or _spawned(module, output)
        assert process.stdin is not None
        with suppress(BrokenPipeError):  # it has failed already: whoever checks will see
            process.stdin.write(config + b"\n")
            process.stdin.flush()
        return process, log_start

    def _left(self) -> list[Child]:
        return [child for child in self.children if child.process.poll() is None]

    def _wait(self, seconds: float) -> None:
        deadline = time.monotonic() + seconds
        while self._left() and time.monotonic() < deadline:
            time.sleep(0.01)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()


def _spawned(module: str, output: IO[bytes]) -> subprocess.Popen[bytes]:
    """``python -m module``."""
    return subprocess.Popen(
        [sys.executable, "-m", module],
        stdin=subprocess.PIPE,
        stdout=output,
        stderr=subprocess.STDOUT,
        env={**os.environ, **ENVIRONMENT},
        start_new_session=True,  # or Ctrl-C would hit it before it can be told to go
    )


def make_fork_server() -> ForkServer | None:
    """A new process that imports what those of a run need; None where they are started from scratch."""
    return ForkServer(FORKED, {**os.environ, **ENVIRONMENT}) if can_fork() else None


def _close_stdin(child: Child) -> None:
    if child.process.stdin is not None:
        with suppress(BrokenPipeError):
            child.process.stdin.close()


def _error(failed: Sequence[Child], limit: int | None = None) -> ProcessError:
    """Name the process that failed and show the end of its log.

    If several failed, most did so because one was gone: that is the one that a signal killed, or else the one that
    cannot use what it was told, or else the one that ended with a traceback.
    """
    first = min(
        failed,
        key=lambda child: (
            child.status >= 0,
            child.status != UNUSABLE,
            "Traceback" not in "".join(child.lines),
        ),
    )
    times = f"{first.restarts} time{'s' * (first.restarts > 1)}"
    again = f" after it had been started again {times}" if first.restarts else ""
    if first.status == UNUSABLE:
        again = ": to start it again would not help"
    elif 0 < first.restarts == limit:
        again += " (--restarts)"
    tail = "\n".join(f"  {line}" for line in first.lines[-_LOG_LINES:] or ["(it is empty)"])
    others = "".join(f"\nAfter it, {child.name} {child.how}." for child in failed if child is not first)
    return ProcessError(
        f"{first.name} {first.how}; the end of its log, {first.log}:\n{tail}{others}\n"
        f"The run is over, because {first.name} {first.how}{again}."
    )


def read_config(config: Path) -> bytes:
    """A configuration as one line of JSON, its files' paths as seen from here.

    Raises:
        CoheftError: It cannot be read.
    """
    try:
        return msgspec.json.encode(_with_paths_from(config.parent, msgspec.json.decode(config.read_bytes())))
    except OSError as error:
        raise CoheftError(f"{config}: cannot be read: {error.strerror}") from error
    except msgspec.DecodeError as error:
        raise CoheftError(f"{config}: not JSON: {error}") from error


def run_in_foreground(module: str, config: Path) -> int:
    """Run one part of a team by hand until it ends; its output is ours. Return its exit status.

    Raises:
        CoheftError: The configuration cannot be read, or is another part's.
    """
    line = read_config(config)
    _check_part(module, config, line)
    process = subprocess.Popen(
        [sys.executable, "-m", module], stdin=subprocess.PIPE, env={**os.environ, **ENVIRONMENT}, start_new_session=True
    )
    assert process.stdin is not None
    try:
        with suppress(BrokenPipeError):  # it has failed already, and said why
            process.stdin.write(line + b"\n")
            process.stdin.flush()
        code = process.wait()
        return code if code >= 0 else KILLED_BY - code
    finally:
        with suppress(BrokenPipeError):
            process.stdin.close()
        try:
            process.wait(_GO_BY_THEMSELVES)
        except subprocess.TimeoutExpired:
            process.kill()


def _check_part(module: str, config: Path, line: bytes) -> None:
    """Check that a configuration is none for something else. All the rest is for the part itself to check.

    Raises:
        CoheftError: It is; the message says for what.
    """
    found = msgspec.json.decode(line)
    for key, (part, what) in _BY_HAND.items():
        if part != module and isinstance(found, dict) and key in found:
            raise CoheftError(f"{config} is {what}")


def _with_paths_from(folder: Path, config: Any) -> Any:
    """A configuration whose files' paths are seen from the folder it lies in, as seen from here."""
    if isinstance(config, dict) and isinstance(security := config.get("security"), dict):
        config["security"] = {name: str((folder / str(path)).resolve()) for name, path in security.items()}
    return config
