"""Time from the command to the first block, imports and memory of each process, against bare processes.

Bare processes import only the libraries that the real ones need in any case.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Self

import psutil

from benchmarks.figures import Effort, Figure, Section, against
from benchmarks.scenarios import SETTLED
from coheft.app.run.folder import RunFile, find_run
from coheft.app.run.observer import observe
from coheft.app.run.processes import ENVIRONMENT
from coheft.errors import CoheftError, LinkError
from coheft.wire.messages.requests import Status

ROBOTS = 6
_FIRST_BLOCK_BAR, _IMPORT_BAR, _MEMORY_BAR = 1.0, 0.3, 60.0
_TURNS: dict[Effort, int] = {"short": 3, "usual": 5, "full": 20}
_LIMIT = 120.0
_POLL = 0.005
_USUAL = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
"""Environment in which modules are compiled only once, as users have it."""
_LEAST = "import msgspec, numpy, zenoh"
"""Imports that agents and the command need in any case."""
_IMPORTED = {
    "an agent": "import coheft.agents.process.main",
    "the server": "import coheft.physics_server.server",
    "the command": "import coheft.app.cli.main, coheft.app.run.launch",
}


def measure(effort: Effort) -> Section:
    """Measure start, imports and memory."""
    turns = _TURNS[effort]
    figures = [*_first_block(turns), *_imports(turns), *_memory()]
    return Section(name="startup", title="Start-up and memory", figures=figures)


def _first_block(turns: int) -> list[Figure]:
    real, bare = [], []
    for _ in range(turns):
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder, Run(Path(folder)) as run:
            real.append(run.began() - run.called_at)
        bare.append(_bare_start())
    name = f"from the command to the first block, N = {ROBOTS}"
    return [
        Figure(
            name=name,
            value=statistics.median(real),
            unit="s",
            bar=_FIRST_BLOCK_BAR,
            note=f"best of {turns}: {min(real):.2f} s",
        ),
        against(f"{name}, against bare processes", real, bare, is_guarded=True),
    ]


def _bare_start() -> float:
    """Return the time in which one bare process starts seven others [s]."""
    commands = [f"{_LEAST}, mujoco", *[_LEAST] * ROBOTS]
    code = (
        f"{_LEAST}, subprocess, sys\n"
        f"children = [subprocess.Popen([sys.executable, '-c', c], start_new_session=True) for c in {commands}]\n"
        "sys.exit(max(child.wait() for child in children))"
    )
    began = time.monotonic()
    # In separate sessions, as the real ones: schedulers may share time among sessions.
    subprocess.run([sys.executable, "-c", code], check=True, start_new_session=True, env={**_USUAL, **ENVIRONMENT})
    return time.monotonic() - began


class Run:
    """``coheft run ring6`` in a separate process, which ends with the context.

    ``called_at`` is the time of the command, by ``time.monotonic`` [s].
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._errors = folder / "stderr.txt"
        self.called_at = time.monotonic()
        command = [sys.executable, "-m", "coheft", "run", "ring6", "--duration", "1000"]
        with self._errors.open("wb") as errors:
            self._process = subprocess.Popen(
                [*command, "--quiet", "--logs", str(folder)], stderr=errors, start_new_session=True, env=_USUAL
            )

    def began(self) -> float:
        """Return when the first block began, by ``time.monotonic`` [s]; raise ``LinkError`` if it does not."""
        status, _ = self._wait_for(lambda status: status.real_time_factor > 0.0)
        return time.monotonic() - status.time / status.real_time_factor

    def memory(self, simulated: float) -> dict[str, float]:
        """Return the resident memory of each process at a simulated time [s], by name [MB]; or raise ``LinkError``."""
        _, run_file = self._wait_for(lambda status: status.time >= simulated)
        pids = {"the command": self._process.pid, **run_file.pids}
        return {name: psutil.Process(pid).memory_info().rss / 1e6 for name, pid in pids.items()}

    def _wait_for(self, condition: Callable[[Status], bool]) -> tuple[Status, RunFile]:
        """Wait until the run's status meets a condition."""
        while True:
            try:
                run_file = find_run(self._folder)
                break
            except CoheftError:
                self._check()
        with observe(run_file) as observer:
            while (status := observer.status()) is None or not condition(status):
                self._check()
        return status, run_file

    def _check(self) -> None:
        """Check that the run goes on, and pause before the next look."""
        errors = self._errors.read_text(errors="replace").strip()
        if self._process.poll() is not None:
            raise LinkError(f"'coheft run' has ended, with status {self._process.returncode}: {errors}")
        if time.monotonic() > self.called_at + _LIMIT:
            raise LinkError(f"'coheft run' is not where it should be after {_LIMIT:g} s: {errors}")
        time.sleep(_POLL)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()  # its children see the end of their stdin
        self._process.wait(_LIMIT)


def _imports(turns: int) -> list[Figure]:
    figures = []
    for name, code in _IMPORTED.items():
        times, least = zip(*((_import_time(code), _import_time(_LEAST)) for _ in range(turns)), strict=True)
        what = f"imports of {name}, against msgspec, numpy and zenoh"
        figures.append(against(what, times, least, is_guarded=True, of=" of CPU time"))
        if name == "an agent":
            median = statistics.median(times)
            figures.append(Figure(name=f"imports of {name}", value=median, unit="s", bar=_IMPORT_BAR))
    return figures


def _import_time(code: str) -> float:
    """Return the CPU time of an import in a new process [s]."""
    return _printed(f"import time; began = time.process_time(); {code}; print(time.process_time() - began)")


def _printed(code: str) -> float:
    """Run code in a new process, and return the number that it prints."""
    command, environment = [sys.executable, "-c", code], {**_USUAL, **ENVIRONMENT}
    return float(subprocess.run(command, check=True, capture_output=True, text=True, env=environment).stdout)


def _memory() -> list[Figure]:
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder, Run(Path(folder)) as run:
        memory = run.memory(SETTLED)
    bare = _printed(f"{_LEAST}, psutil; print(psutil.Process().memory_info().rss / 1e6)")
    others = {"the server": memory.pop("server"), "the command": memory.pop("the command")}
    agent = statistics.median(memory.values())
    return [
        Figure(name="resident memory of an agent", value=agent, unit="MB", bar=_MEMORY_BAR),
        Figure(
            name="resident memory of an agent, against a bare process",
            value=agent / bare,
            is_guarded=True,
            note=f"{agent:.0f} against {bare:.0f} MB with msgspec, numpy and zenoh",
        ),
        *(Figure(name=f"resident memory of {name}", value=size, unit="MB") for name, size in others.items()),
    ]
