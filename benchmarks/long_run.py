"""A long run in real time with load changes and an agent that is killed repeatedly: does the need of memory grow?

Prints the resident memory and open files of every process that ran for at least ten minutes: five minutes after its
start, at its end, and three times in between. The exit status is that of the run.
"""

import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import psutil

from benchmarks.command import run_command
from coheft.app.run.folder import find_run
from coheft.app.run.observer import ask_run
from coheft.errors import CoheftError
from coheft.wire.messages.requests import InjectRequest, RemoveRequest, StatusRequest

SAMPLE_EVERY = 10.0
CHANGE_EVERY = 60.0
LAST_WORDS = 5.0
"""Time before the end of a run without requests [s]. It is short, because an agent's memory grows with the time since
a load change, so it has to be compared at equal times after changes."""
SETTLED = 300.0
"""Time after which a process should not grow, because all of its code has been loaded [s]."""
WINDOW = 60.0
"""Time over which the median of the memory is taken [s]."""
BETWEEN = (0.25, 0.5, 0.75)
"""Shares of the remaining time at which memory is also printed, because leaks grow evenly."""


@dataclass
class Life:
    """One process: times of samples [s], memory [B] and number of open files."""

    name: str
    pid: int
    times: list[float] = field(default_factory=list)
    memory: list[int] = field(default_factory=list)
    files: list[int] = field(default_factory=list)

    def sample(self, now: float) -> None:
        """Add a sample, if the process still exists."""
        try:
            process = psutil.Process(self.pid)
            memory, files = process.memory_info().rss, process.num_fds()
        except (psutil.NoSuchProcess, psutil.AccessDenied):  # the latter for a zombie
            return
        if memory:  # not for a zombie
            self.times.append(now)
            self.memory.append(memory)
            self.files.append(files)

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return self.times[-1] - self.times[0] if self.times else 0.0

    def at(self, age: float) -> tuple[float, int]:
        """Return median memory [B] and largest number of open files within ``WINDOW`` before an age [s]."""
        ages = [moment - self.times[0] for moment in self.times]
        chosen = [k for k, value in enumerate(ages) if age - WINDOW <= value <= age]
        return statistics.median(self.memory[k] for k in chosen), max(self.files[k] for k in chosen)


@dataclass
class Troubles:
    """Changes the load and kills the last robot's agent at regular times, and counts both."""

    folder: Path
    kill_every: float
    changes: int = 0
    kills: int = 0

    def make(self, elapsed: float) -> None:
        """Cause what is due."""
        if elapsed >= (self.changes + 1) * CHANGE_EVERY:
            loads = ask_run(StatusRequest(), self.folder).loads
            put = InjectRequest(mass=2.0, position=(0.2, 0.1, 0.08))
            ask_run(RemoveRequest(load=loads[-1].id) if loads else put, self.folder)
            self.changes += 1
        if elapsed >= (self.kills + 1) * self.kill_every:
            run_file = find_run(self.folder)
            with suppress(ProcessLookupError):  # it has just ended
                os.kill(run_file.pids[list(run_file.agents)[-1]], signal.SIGKILL)
            self.kills += 1


def follow(run: subprocess.Popen[bytes], troubles: Troubles, seconds: float) -> list[Life]:
    """Sample all processes of a run until it ends."""
    lives = [Life("supervisor", run.pid)]
    began = time.monotonic()
    while run.poll() is None:
        elapsed = time.monotonic() - began
        try:
            known = {life.pid for life in lives}
            lives += [Life(name, pid) for name, pid in find_run(troubles.folder).pids.items() if pid not in known]
            if elapsed < seconds - LAST_WORDS:
                troubles.make(elapsed)
        except CoheftError as error:  # the run has not begun, or has ended
            print(f"after {elapsed:.0f} s: {error}", file=sys.stderr)
        for life in lives:
            life.sample(elapsed)
        with suppress(subprocess.TimeoutExpired):
            run.wait(SAMPLE_EVERY)
    return lives


def print_table(lives: list[Life]) -> None:
    """Print one line per process."""
    times = "".join(f"{f'at {share:.0%}':>9}" for share in BETWEEN)
    print(
        f"{'process':12}{'minutes':>8}{'MB at 5 min':>13}{times}{'at its end':>12}{'growth':>9}{'files':>8}"
        f"{'at its end':>12}"
    )
    for life in lives:
        if life.duration < 2 * SETTLED - WINDOW:
            continue
        (before, files_before), (after, files_after) = life.at(SETTLED), life.at(life.duration)
        between = (life.at(SETTLED + share * (life.duration - SETTLED))[0] for share in BETWEEN)
        print(
            f"{life.name:12}{life.duration / 60:8.1f}{before / 1e6:13.1f}"
            f"{''.join(f'{memory / 1e6:9.1f}' for memory in between)}{after / 1e6:12.1f}"
            f"{100 * (after / before - 1):8.1f}%{files_before:8}{files_after:12}"
        )


def main(*, minutes: float = 60.0, scenario: str = "ring3", sensor_rate: int = 200, kill_every: float = 240.0) -> int:
    """Run, and print the table.

    Args:
        minutes: Duration of the run.
        scenario: Its scenario.
        sensor_rate: Samples per second.
        kill_every: Time from one kill to the next [s].
    """
    seconds = 60.0 * minutes
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # so that the run also ends
    with tempfile.TemporaryDirectory() as name:
        troubles = Troubles(Path(name), kill_every)
        run = subprocess.Popen(
            [sys.executable, "-m", "coheft", "run", scenario, "--realtime", "--duration", str(seconds)]
            + ["--sensor-rate", str(sensor_rate), "--restarts", "1000", "--logs", name],
        )
        try:
            lives = follow(run, troubles, seconds)
        finally:
            if run.poll() is None:
                run.terminate()
            run.wait()
    print(f"\nexit status {run.returncode}; {troubles.changes} changes of the load, {troubles.kills} agents killed\n")
    print_table(lives)
    return run.returncode


if __name__ == "__main__":
    run_command(main, __doc__)
