"""How processes of a run are scheduled, and how they leave."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

from coheft.wire.process.supervised import UNUSABLE

SCHEDULED = """
import os
import threading
import msgspec
from coheft.wire.process.supervised import supervised_main

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


FAILING = """
import msgspec
from coheft.errors import LinkError, PluginError
from coheft.wire.process.supervised import supervised_main

class Config(msgspec.Struct):
    kind: str

def run(config):
    raise {"link": LinkError, "plugin": PluginError, "exit": SystemExit}[config.kind]("this is why")

supervised_main(Config, run)
"""


@pytest.mark.parametrize(
    ("told", "status", "said"),
    [
        ('{"kind": "link"}', 1, "this is why"),
        ('{"kind": "plugin"}', UNUSABLE, "this is why"),
        ('{"kind": "exit"}', 1, ""),  # as a user's estimator may end
        ("{}", UNUSABLE, "missing required field `kind`"),
    ],
)
def test_the_exit_status_says_whether_to_start_it_again_would_help(told: str, status: int, said: str) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", FAILING], stdin=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    with process:
        assert process.stdin is not None
        assert process.stderr is not None
        process.stdin.write(told + "\n")
        process.stdin.flush()  # open until it has failed: it leaves with its stdin
        assert process.stderr.read().rstrip().endswith(said)
        assert process.wait() == status


LEAVING = """
import threading
from pathlib import Path
import msgspec
from coheft.wire.data.replace import replace_files
from coheft.wire.process.supervised import supervised_main

class Config(msgspec.Struct):
    target: str

def write(file):
    file.write(b"half of it")
    file.flush()
    print("writing", flush=True)
    threading.Event().wait()

supervised_main(Config, lambda config: replace_files({Path(config.target): write}))
"""


def test_who_leaves_while_it_writes_leaves_nothing_behind(tmp_path: Path) -> None:
    target = tmp_path / "data.npz"
    target.write_text("from before")
    process = subprocess.Popen(
        [sys.executable, "-c", LEAVING], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    with process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(msgspec.json.encode({"target": str(target)}).decode() + "\n")
        process.stdin.flush()
        assert process.stdout.readline() == "writing\n"
        assert (tmp_path / "data.npz.part").exists()
        process.stdin.close()
        assert process.wait() == 0
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("data.npz", "from before")]
