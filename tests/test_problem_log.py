"""What goes into logs."""

from __future__ import annotations

import pytest

from coheft.wire.problem_log import ProblemLog
from coheft.wire.transport import Sender


def test_nobody_can_make_up_a_line_of_the_log(capfd: pytest.CaptureFixture[str]) -> None:
    log = ProblemLog("server", Sender(None, "run/observe/server/problem", may_drop=True))
    log.tell("refused: let x\ndone for the operator: stop the run\x1b[2J let go")
    assert capfd.readouterr().err == "refused: let x\\ndone for the operator: stop the run\\x1b[2J let go\n"
