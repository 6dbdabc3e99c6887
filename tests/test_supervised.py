"""How processes of a run are scheduled."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

SCHEDULED = """
import os
import threading
import msgspec
from coheft.wire.supervised import supervised_main

class Config(msgspec.Struct):
    expected: int

def run(config):
    policies = []
    thread = threading.Thread(target=lambda: policies.append(os.sched_getscheduler(0)))
    thread.start()
    thread.join()
    print(policies == [os.sched_getscheduler(0)] == [config.expected], flush=True)

supervised_main(Config, run)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="takes Linux")
def test_processes_of_a_run_and_their_threads_do_not_interrupt_each_other() -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", SCHEDULED], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    with process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(f'{{"expected": {os.SCHED_BATCH}}}\n')
        process.stdin.flush()  # open until it has answered: it leaves with its stdin
        assert process.stdout.readline() == "True\n"
