"""The supervisor's view of its processes, with small ones in the place of a run's."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path
from typing import cast

import pytest

from coheft.app.run.folder import RUN_FILE, RunFile, announce
from coheft.app.run.launch import Restarts
from coheft.app.run.observer import Observer
from coheft.app.run.processes import ProcessError, Processes, make_fork_server
from coheft.app.terminal.screen import Display
from coheft.wire.messages.requests import StatusRequest
from coheft.wire.process.supervised import UNUSABLE
from tests.waiting import LIMIT, wait_until

# Like a server that loses the link with a robot before the robot's process has ended.
FOLLOWS = """
import pathlib, sys, time
while not pathlib.Path("cause-is-up").exists():
    time.sleep(0.001)
pathlib.Path("link-is-lost").touch()
sys.exit("lost the link with cause")
"""
CAUSE = """
import pathlib, time
pathlib.Path("cause-is-up").touch()
while not pathlib.Path("link-is-lost").exists():
    time.sleep(0.001)
time.sleep(0.1)
raise ValueError("this is why")
"""


# Fails the first time, not the second one.
FAILS_ONCE = """
import pathlib, sys
print("I am here")
first = pathlib.Path("has-failed")
if not first.exists():
    first.touch()
    sys.exit("something was wrong")
sys.stdin.readline()
sys.stdin.read()
"""


# Ends as it is told, once at a time.
ENDS = """
import os, pathlib, sys
how = pathlib.Path("how")
lines = how.read_text().splitlines()
how.write_text("\\n".join(lines[1:]))
exec(lines[0])
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where modules that are started are looked for."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *filter(None, sys.path)]))
    return tmp_path


def test_files_in_the_current_folder_do_not_take_the_place_of_modules(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, sys.path)))
    (tmp_path / "queue.py").write_text("raise ValueError('a file of the user')")
    for fork_server in (None, make_fork_server()):
        with Processes(tmp_path, fork_server) as processes:
            child = processes.start("r1", "coheft.agents.process.main", StatusRequest())
            assert child.process.wait(LIMIT) == UNUSABLE
            assert "expected AgentProcessConfig" in child.how_and_why


def test_a_process_that_fails_last_but_with_a_traceback_is_the_cause(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "coheft.app.run.processes._FURTHER_FAILURES", 30.0
    )  # a busy machine may need more than half a second
    (folder / "follows.py").write_text(FOLLOWS)
    (folder / "cause.py").write_text(CAUSE)
    with Processes(folder) as processes:
        follows = processes.start("follows", "follows", StatusRequest())
        processes.start("cause", "cause", StatusRequest())
        follows.process.wait()
        with pytest.raises(ProcessError, match=r"^cause ended with status 1(?s:.)*this is why") as caught:
            processes.check()
    assert "After it, follows ended with status 1" in str(caught.value)


def test_a_process_that_failed_can_be_started_again_with_what_it_was_told_and_its_log_goes_on(folder: Path) -> None:
    (folder / "fails_once.py").write_text(FAILS_ONCE)
    with Processes(folder) as processes:
        child = processes.start("fails", "fails_once", StatusRequest())
        child.process.wait()
        assert processes.failed == [child]
        processes.start_again(child)
        (again,) = processes.children
        assert again.restarts == 1
        assert processes.pids == {"fails": again.process.pid}
        processes.check()
        wait_until(lambda: len(again.lines) == 3, "its last words")
    assert again.process.returncode == 0
    assert again.lines == ["I am here", "something was wrong", "I am here"]


def test_a_process_is_started_again_though_someone_has_removed_the_folder_of_the_logs(folder: Path) -> None:
    (folder / "fails_once.py").write_text(FAILS_ONCE)
    logs = folder / "logs"
    logs.mkdir()
    with Processes(logs) as processes:
        child = processes.start("fails", "fails_once", StatusRequest())
        child.process.wait()
        shutil.rmtree(logs)
        assert child.lines == []
        processes.start_again(child)
        announce(logs, RunFile(run="run", server="tcp/127.0.0.1:1", agents={}, pids=processes.pids))
        (again,) = processes.children
        wait_until(lambda: again.lines == ["I am here"], "its words")
        shutil.rmtree(logs)
        announce(logs, RunFile(run="run", server="tcp/127.0.0.1:1", agents={}, pids=processes.pids))
        assert (logs / RUN_FILE).exists()


def test_why_a_process_ended_is_in_its_own_last_words_or_the_signal(folder: Path) -> None:
    (folder / "ends.py").write_text(ENDS)
    ways = {
        "print('first'); print('then \\x1b[1m', file=sys.stderr); sys.exit(1)": "ended with status 1: then \\x1b[1m",
        "os._exit(3)": "ended with status 3, and did not say why",
        "raise ValueError('this is why')": "ended with status 1: ValueError: this is why",
        "print('not why', flush=True); os.kill(os.getpid(), 9)": "was killed by signal 9",
    }
    (folder / "how").write_text("\n".join(ways))
    with Processes(folder) as processes:
        child = processes.start("ends", "ends", StatusRequest())
        for said in ways.values():
            child.process.wait()
            assert child.how_and_why == said
            if said != list(ways.values())[-1]:
                processes.start_again(child)
                (child,) = processes.children


def test_who_cannot_use_what_it_was_told_is_the_cause(folder: Path) -> None:
    (folder / "lost.py").write_text("import sys; sys.exit('lost the link')")
    (folder / "unusable.py").write_text("import sys; print('no such thing'); sys.exit(2)")
    with Processes(folder) as processes:
        for name in ("lost", "unusable"):
            processes.start(name, name, StatusRequest()).process.wait()
        with pytest.raises(ProcessError, match=r"^unusable ended with status 2(?s:.)*After it, lost ended") as caught:
            processes.check()
    assert str(caught.value).endswith("because unusable ended with status 2; restarting it would not help.")


@pytest.mark.parametrize(
    ("status", "limit", "others", "is_limit"),
    [
        (1, 1, (), True),
        (1, 1, ("server",), False),
        (UNUSABLE, 1, (), False),
        (UNUSABLE, 3, (), False),
    ],
)
def test_the_limit_of_restarts_is_named_only_where_it_is_why_there_is_none(
    status: int, limit: int, others: tuple[str, ...], is_limit: bool, folder: Path
) -> None:
    (folder / "fails.py").write_text(f"import sys\nsys.exit({status})\n")
    with Processes(folder) as processes:
        processes.start("r1", "fails", StatusRequest()).process.wait()
        processes.start_again(processes.children[0])
        for name in others:
            processes.start(name, "fails", StatusRequest())
        for child in processes.children:
            child.process.wait()
        unasked = cast(Observer, None)
        with pytest.raises(ProcessError, match="because r1 ended with status") as caught:
            Restarts(limit, processes, unasked, Display(), lambda: None).check()
    assert ("(--restarts)" in str(caught.value)) == is_limit
