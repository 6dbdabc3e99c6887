"""Standard output that is closed, full, or read by no one any more; and Ctrl-C before there is any."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from coheft.app.run.folder import RUN_FILE, RunFile
from tests.integration.command_line import Run, alive
from tests.waiting import LIMIT

COHEFT = [sys.executable, "-m", "coheft"]
LOST = "printed text is lost"

pytestmark = [
    pytest.mark.skipif(os.name != "posix", reason="redirected by a shell"),
    pytest.mark.usefixtures("own_state_folder"),
]
needs_full = pytest.mark.skipif(not Path("/dev/full").exists(), reason="no disk that is always full")


def redirected(where: str, *arguments: str) -> tuple[int, str]:
    """Exit status and what is said on standard error."""
    line = ["sh", "-c", f'exec "$@" {where}', "sh", *COHEFT, *arguments]
    done = subprocess.run(line, stderr=subprocess.PIPE, text=True, timeout=LIMIT, check=False)
    return done.returncode, done.stderr


CLOSED = pytest.param(">&-", "it is closed", id="closed")
FULL = pytest.param("> /dev/full", "No space left on device", id="full", marks=needs_full)


@pytest.mark.parametrize("arguments", [["scenarios"], ["help"], ["--version"], ["completion", "bash"]])
def test_what_is_lost_is_an_error_in_one_line(arguments: list[str]) -> None:
    assert redirected(">&-", *arguments) == (1, f"coheft: standard output: it is closed; {LOST}\n")


@needs_full
def test_what_does_not_fit_on_the_disk_is_an_error_in_one_line() -> None:
    assert redirected("> /dev/full", "scenarios") == (
        1,
        f"coheft: standard output: No space left on device; {LOST}\n",
    )


def test_if_standard_error_is_closed_as_well_the_status_tells() -> None:
    assert redirected(">&- 2>&- <&-", "scenarios") == (1, "")


@pytest.mark.parametrize("where", [">&-", "2>&-"])
def test_what_nothing_is_written_to_may_be_closed(where: str) -> None:
    status, said = redirected(where, "run", "ring3", "--duration", "2", "--quiet")
    assert status in (0, 3)
    assert said == ""


def test_wrong_usage_stays_wrong_usage() -> None:
    status, said = redirected(">&-", "run", "ring5")
    assert status == 2
    assert "ring5" in said


@pytest.mark.parametrize(("where", "reason"), [CLOSED, FULL])
def test_a_run_whose_output_is_lost_goes_on_and_saves_its_files(where: str, reason: str, tmp_path: Path) -> None:
    report, data, logs = tmp_path / "report.json", tmp_path / "data.npz", tmp_path / "logs"
    asked = ("--json", str(report), "--save-data", str(data), "--logs", str(logs))
    assert redirected(where, "run", "ring3", "--duration", "3", *asked) == (
        1,
        f"coheft: standard output: {reason}; {LOST}\n",
    )
    check_saved(report, data)


def check_saved(report: Path, data: Path) -> None:
    assert msgspec.json.decode(report.read_bytes())["robots"].keys() == {"r1", "r2", "r3"}
    assert data.stat().st_size > 0


def test_a_run_whose_reader_has_gone_ends_its_processes_and_saves_its_files(tmp_path: Path) -> None:
    report, data, logs = tmp_path / "report.json", tmp_path / "data.npz", tmp_path / "logs"
    arguments = ["--duration", "10", "--json", str(report), "--save-data", str(data), "--logs", str(logs)]
    process = subprocess.Popen(
        [*COHEFT, "run", "ring3", *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stderr is not None
    assert any(" s of 10 s" in line for line in process.stdout), "notes come first"
    pids = msgspec.json.decode((logs / RUN_FILE).read_bytes(), type=RunFile).pids
    process.stdout.close()
    assert process.stderr.read() == ""
    assert process.wait(LIMIT) == 1
    process.stderr.close()
    check_saved(report, data)
    assert len(pids) == 4
    assert not any(map(alive, pids.values()))


def test_who_has_read_enough_may_close_the_pipe() -> None:
    assert without_reader("scenarios") == (1, b"")


def test_watching_ends_when_the_reader_is_gone(start: Callable[..., Run]) -> None:
    run = start("--duration", "10000")
    run.wait_until_under_way()
    assert without_reader("watch", "--run", str(run.folder)) == (1, b"")
    assert run.supervisor.poll() is None


def without_reader(*arguments: str) -> tuple[int, bytes]:
    """Exit status and standard error of a command whose output no one reads."""
    process = subprocess.Popen([*COHEFT, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None
    process.stdout.close()
    process.stdout = None
    _, said = process.communicate(timeout=LIMIT)
    return process.returncode, said


def test_letters_that_are_not_in_the_encoding_end_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    done = subprocess.run([*COHEFT, "run", "ring3", "--duration", "2"], capture_output=True, timeout=LIMIT, check=False)
    assert done.returncode in (0, 3)
    assert done.stderr == b""
    assert rb"inertia, kg\xb7m\xb2" in done.stdout


@pytest.mark.parametrize(
    "module", ["coheft.app.terminal.standard_output", "cyclopts.core", "coheft.app.cli.main", "numpy", "zenoh"]
)
def test_ctrl_c_while_modules_load_is_told_in_a_line(module: str) -> None:
    """Each module that has been loaded is told on standard error, in a line of its own."""
    with subprocess.Popen(
        [sys.executable, "-X", "importtime", "-m", "coheft", "run", "ring3", "--duration", "10000"],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
    ) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if line.rpartition("|")[2].strip() == module:
                break
        process.send_signal(signal.SIGINT)
        said = [line for line in process.stderr if not line.startswith("import time:")]
        assert process.wait(LIMIT) == 130, said
    assert len(said) == 1
    assert said[0].startswith("stopped")


INTERRUPTED = """
import coheft.app.cli.main

def interrupted(_):
    raise KeyboardInterrupt

coheft.app.cli.main.run_command_line = interrupted
from coheft.__main__ import main
main()
"""


def test_ctrl_c_a_moment_before_the_command_begins_is_told_in_a_line() -> None:
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (130, "stopped\n")
