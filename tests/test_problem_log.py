"""What goes into logs."""

from __future__ import annotations

import pytest

from coheft.wire.process.log import LOG, LogLevel, log_to_stderr
from coheft.wire.process.problem_log import ProblemLog
from coheft.wire.transport.sessions import Sender
from tests.wall_clock import wall_clock_of

pytestmark = pytest.mark.usefixtures("process_log")


@pytest.mark.parametrize(
    ("level", "written"), [("info", ["waiting", "refused"]), ("warning", ["refused"]), ("error", [])]
)
def test_the_log_has_what_is_important_enough(
    level: LogLevel, written: list[str], capfd: pytest.CaptureFixture[str]
) -> None:
    log_to_stderr(level)
    LOG.info("waiting")
    LOG.warning("refused")
    assert capfd.readouterr().err.splitlines() == written


def test_nobody_can_make_up_a_line_of_the_log(capfd: pytest.CaptureFixture[str]) -> None:
    log_to_stderr()
    log = ProblemLog("server", Sender(None, "run/observe/server/problem", may_drop=True))
    log.tell("refused: let x\ndone for the operator: stop the run\x1b[2J let go")
    assert capfd.readouterr().err == "refused: let x\\ndone for the operator: stop the run\\x1b[2J let go\n"


def test_who_sends_rubbish_without_end_does_not_fill_the_disk_and_is_counted(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    log_to_stderr()
    now = wall_clock_of("coheft.wire.process.problem_log", monkeypatch)
    log = ProblemLog("server", Sender(None, "run/observe/server/problem", may_drop=True))

    def printed(count: int) -> list[str]:
        for _ in range(count):
            log.tell("rubbish")
        return capfd.readouterr().err.splitlines()

    assert printed(1000) == 50 * ["rubbish"]
    now.time = 1.0
    assert printed(10) == ["rubbish (and 950 more problems before)", *4 * ["rubbish"]]
    now.time = 1000.0
    assert printed(60) == ["rubbish (and 5 more problems before)", *49 * ["rubbish"]]
    assert log.count == 1070
