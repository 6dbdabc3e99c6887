"""Calls side by side: as many as there are cores for, each with one thread of mathematics."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

pytest.importorskip("joblib")

from coheft.app.run.parallel import side_by_side, workers
from coheft.errors import CoheftError


def threads(number: int) -> tuple[int, str | None, int]:
    return number, os.environ.get("OPENBLAS_NUM_THREADS"), os.getpid()


def test_all_calls_are_made_by_other_processes_with_one_thread_each() -> None:
    with workers(2):
        found = list(side_by_side(threads, ((number,) for number in range(8))))
    assert sorted(number for number, _, _ in found) == list(range(8))
    assert {each for _, each, _ in found} == {"1"}
    assert os.getpid() not in {process for _, _, process in found}


def test_options_of_python_stay_as_they_are() -> None:
    options = list(sys.warnoptions)
    with workers(2):
        assert sys.warnoptions != options
    assert sys.warnoptions == options


def test_ctrl_c_is_left_to_the_process_that_ends_the_others() -> None:
    with workers(2):
        assert list(side_by_side(signal.getsignal, [(signal.SIGINT,)] * 2)) == [signal.SIG_IGN] * 2
    with workers(1):  # which makes all calls itself
        assert list(side_by_side(signal.getsignal, [(signal.SIGINT,)])) == [signal.getsignal(signal.SIGINT)]


def kill_this_process(number: int) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return number


def test_a_killed_worker_is_an_error_in_words() -> None:
    with pytest.raises(CoheftError, match="was killed, possibly because memory ran out: use fewer"), workers(2):
        list(side_by_side(kill_this_process, ((number,) for number in range(4))))


INTERRUPTED = """
from joblib.externals.loky.backend import resource_tracker
from coheft.app.run.parallel import side_by_side, workers
with workers(2):
    results = side_by_side(pow, ((1, 1) for _ in range(100)))
    next(results)
    resource_tracker.register("/that-is-gone", "semlock")
del results
"""


def test_joblib_says_nothing_beside_the_words_of_an_interrupted_command() -> None:
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("", "")


ONE_CORE = """
import os
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
from coheft.app.run.parallel import usual_jobs
print(usual_jobs())
"""


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="this system binds no process to cores")
def test_only_cores_that_may_be_used_count() -> None:
    done = subprocess.run([sys.executable, "-c", ONE_CORE], capture_output=True, text=True, check=True)
    assert done.stdout == "1\n"
