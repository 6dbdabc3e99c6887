"""The supervisor's view of its processes, with small ones in the place of a run's."""

from __future__ import annotations

from pathlib import Path
from typing import cast

import pytest

from coheft.app.observer import Observer
from coheft.app.processes import ProcessError, Processes
from coheft.app.restarts import Restarts
from coheft.app.terminal import QuietDisplay
from coheft.wire.requests import StatusRequest
from coheft.wire.supervised import UNUSABLE_CONFIG
from tests.waiting import wait_until

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


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where modules that are started are looked for."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_process_that_fails_last_but_with_a_traceback_is_the_cause(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("coheft.app.processes._OTHERS_FAIL", 30.0)  # a busy machine may need more than half a second
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


@pytest.mark.parametrize(
    ("status", "limit", "others", "is_limit"),
    [
        (1, 1, (), True),
        (1, 1, ("server",), False),
        (UNUSABLE_CONFIG, 1, (), False),
        (UNUSABLE_CONFIG, 3, (), False),
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
            Restarts(limit, processes, unasked, QuietDisplay(), lambda: None).check()
    assert ("(--restarts)" in str(caught.value)) == is_limit
