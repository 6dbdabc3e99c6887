"""From the command to the first block, what each process imports, and what memory it takes.

    python -m benchmarks.startup [--effort short|usual|full]

Bare processes are started beside it, in turn: one that starts seven others, all of which import nothing but the
libraries that the real ones cannot do without.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import psutil
import zenoh

from benchmarks.figures import Effort, Figure, Section
from benchmarks.runner import run_alone
from benchmarks.stepped_team import SETTLED
from benchmarks.timing import ratio
from coheft.app.run.folder import RunFile, find_run
from coheft.app.run.processes import ENVIRONMENT
from coheft.errors import CoheftError, LinkError
from coheft.wire.messages.requests import Refusal, Status, StatusRequest
from coheft.wire.transport.sessions import Keys, ask, open_session

T = TypeVar("T")

ROBOTS = 6
_FIRST_BLOCK_BAR, _IMPORT_BAR, _MEMORY_BAR = 1.0, 0.3, 60.0
_TURNS: dict[Effort, int] = {"short": 3, "usual": 5, "full": 20}
_LIMIT = 120.0
_POLL = 0.005
_USUAL = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
"""Users' modules are compiled but once."""
_LEAST = "import msgspec, numpy, zenoh"
"""What an agent cannot do without; the supervisor neither."""
_IMPORTED = {
    "an agent": "import coheft.agents.process.main",
    "the server": "import coheft.physics_server.server",
    "the command": "import coheft.app.cli.main, coheft.app.run.launch",
}


def measure(effort: Effort) -> Section:
    """All of it."""
    turns = _TURNS[effort]
    figures = [*_first_block(turns), *_imports(turns), *_memory()]
    return Section(name="startup", title="Start-up and memory", figures=figures)


def _first_block(turns: int) -> list[Figure]:
    real, bare = [], []
    for _ in range(turns):
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder, Run(Path(folder)) as run:
            real.append(run.began() - run.called_at)
        bare.append(_bare_start())
    seconds = statistics.median(real)
    return [
        Figure(
            name=f"from the command to the first block, N = {ROBOTS}",
            value=seconds,
            unit="s",
            bar=_FIRST_BLOCK_BAR,
            note=f"best of {turns}: {min(real):.2f} s",
        ),
        Figure(
            name=f"from the command to the first block, N = {ROBOTS}, against bare processes",
            value=ratio(real, bare),
            is_guarded=True,
            note=f"bare ones take {statistics.median(bare):.2f} s",
        ),
    ]


def _bare_start() -> float:
    """Time that it takes to start as many processes [s]."""
    commands = [f"{_LEAST}, mujoco", *[_LEAST] * ROBOTS]
    code = (
        f"{_LEAST}, subprocess, sys\n"
        f"children = [subprocess.Popen([sys.executable, '-c', c], start_new_session=True) for c in {commands}]\n"
        "sys.exit(max(child.wait() for child in children))"
    )
    began = time.monotonic()
    # In sessions of their own, as the real ones: schedulers may share time among sessions.
    subprocess.run([sys.executable, "-c", code], check=True, start_new_session=True, env={**_USUAL, **ENVIRONMENT})
    return time.monotonic() - began


class Run:
    """'coheft run ring6' in a process of its own, ended with the context."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._said = folder / "stderr.txt"
        self.called_at = time.monotonic()
        command = [sys.executable, "-m", "coheft", "run", "ring6", "--duration", "1000"]
        with self._said.open("wb") as said:
            self._process = subprocess.Popen(
                [*command, "--quiet", "--logs", str(folder)], stderr=said, start_new_session=True, env=_USUAL
            )

    def began(self) -> float:
        """When the first block began, of the clock ``time.monotonic``.

        Raises:
            LinkError: None does.
        """
        run_file = self._find()
        with open_session(connect=[run_file.server]) as session:
            status = self._wait_for(lambda: _status(session, run_file, lambda status: status.real_time_factor > 0.0))
            return time.monotonic() - status.time / status.real_time_factor

    def memory(self, simulated: float) -> dict[str, float]:
        """Resident memory of each process once a simulated time [s] has passed, by name [MB].

        Raises:
            LinkError: It does not pass.
        """
        run_file = self._find()
        with open_session(connect=[run_file.server]) as session:
            self._wait_for(lambda: _status(session, run_file, lambda status: status.time >= simulated), every=0.2)
        pids = {"the command": self._process.pid, **run_file.pids}
        return {name: psutil.Process(pid).memory_info().rss / 1e6 for name, pid in pids.items()}

    def _find(self) -> RunFile:
        def found() -> RunFile | None:
            try:
                return find_run(self._folder)
            except CoheftError:
                return None

        return self._wait_for(found)

    def _wait_for(self, look: Callable[[], T | None], every: float = _POLL) -> T:
        """What is seen in the end; until then it is looked for every so many seconds.

        Raises:
            LinkError: Nothing is seen in time, or the run has ended.
        """
        while (seen := look()) is None:
            if self._process.poll() is not None:
                raise LinkError(f"'coheft run' has ended, with status {self._process.returncode}{self._words()}")
            if time.monotonic() > self.called_at + _LIMIT:
                raise LinkError(f"'coheft run' is not where it should be after {_LIMIT:g} s{self._words()}")
            time.sleep(every)
        return seen

    def _words(self) -> str:
        """What it has said on stderr."""
        said = self._said.read_text(errors="replace").strip()
        return f": {said}" if said else ""

    def __enter__(self) -> Run:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()  # its children see the end of their stdin
        self._process.wait(_LIMIT)


def _status(session: zenoh.Session, run_file: RunFile, condition: Callable[[Status], bool]) -> Status | None:
    """How the run is; None if it does not say, or as long as a condition does not hold."""
    try:
        answer = ask(session, Keys(run_file.run).request("observer"), StatusRequest(), timeout=0.5)
    except LinkError:
        return None
    return None if isinstance(answer, Refusal) or not condition(answer) else answer


def _imports(turns: int) -> list[Figure]:
    figures = []
    for name, code in _IMPORTED.items():
        times, least = [], []
        for _ in range(turns):
            times.append(_import_time(code))
            least.append(_import_time(_LEAST))
        is_agent = name == "an agent"
        figures += [
            Figure(
                name=f"imports of {name}, against msgspec, numpy and zenoh",
                value=ratio(times, least),
                is_guarded=True,
                note=f"{statistics.median(times):.3f} against {statistics.median(least):.3f} s of CPU time",
            )
        ]
        if is_agent:
            figures.append(Figure(name=f"imports of {name}", value=statistics.median(times), unit="s", bar=_IMPORT_BAR))
    return figures


def _import_time(code: str) -> float:
    """CPU time that an import takes in a new process [s]."""
    return float(_output(f"import time; began = time.process_time(); {code}; print(time.process_time() - began)"))


def _output(code: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True, env={**_USUAL, **ENVIRONMENT}
    )
    return done.stdout.strip()


def _memory() -> list[Figure]:
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder, Run(Path(folder)) as run:
        memory = run.memory(SETTLED)
    bare = float(_output(f"{_LEAST}, psutil; print(psutil.Process().memory_info().rss / 1e6)"))
    agents: Sequence[float] = [size for name, size in memory.items() if name not in ("server", "the command")]
    agent = statistics.median(agents)
    return [
        Figure(name="resident memory of an agent", value=agent, unit="MB", bar=_MEMORY_BAR),
        Figure(
            name="resident memory of an agent, against a bare process",
            value=agent / bare,
            is_guarded=True,
            note=f"{agent:.0f} against {bare:.0f} MB with msgspec, numpy and zenoh",
        ),
        Figure(name="resident memory of the server", value=memory["server"], unit="MB"),
        Figure(name="resident memory of the command", value=memory["the command"], unit="MB"),
    ]


if __name__ == "__main__":
    run_alone("startup", __doc__)
