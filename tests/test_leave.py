"""The first and the last moments of a process: no traceback, and no abort."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from tests.waiting import LIMIT

pytestmark = pytest.mark.skipif(os.name != "posix", reason="exit statuses as on POSIX")

CLOSES_LATE = """
import sys, time
import zenoh
from coheft.wire.process.leave import leave
from coheft.wire.transport import sessions

def close(session):
    for _ in session.get("silence", timeout=0.3):
        pass

class Last:
    def __del__(self, sleep=time.sleep):
        sleep(0.6)

sessions._close, sessions._CLOSE_TIMEOUT = close, 0.05
sys.modules["last"] = Last()  # Python takes long to shut down
with sessions.open_session() as session:
    silent = session.declare_queryable("silence", zenoh.handlers.FifoChannel(1))
print("said", end="")
leave(3)
"""
"""A call into Zenoh returns while the process ends, as with a frozen process at the other end of a link."""

INTERRUPTED = """
import runpy, sys
sys.modules.pop("signal", None)

class Interrupts:
    def find_spec(self, name, *_):
        if name == "{module}":
            raise KeyboardInterrupt

sys.meta_path.insert(0, Interrupts())
runpy.run_module("coheft", run_name="__main__")
"""


def ended(code: str) -> tuple[int, str, str]:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=LIMIT, check=False)
    return done.returncode, done.stdout, done.stderr


def test_a_session_that_still_closes_does_not_abort_the_process() -> None:
    assert ended(CLOSES_LATE) == (3, "said", "")


def test_ctrl_c_leaves_no_traceback_before_there_is_a_handler() -> None:
    assert ended(INTERRUPTED.format(module="signal")) == (130, "", "stopped\n")


def test_before_ctrl_c_has_a_handler_nothing_is_imported_that_takes_time() -> None:
    code = "import __future__, sys; before = set(sys.modules); import coheft; print(*set(sys.modules) - before)"
    assert ended(code) == (0, "coheft\n", "")
