"""Free memory goes back to the system, also from between what stays, but not at once."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from coheft.wire.process.memory import trimming

HOLES = """
import os
from pathlib import Path
import numpy as np
from coheft.wire.process.memory import trimming

def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

arrays = [np.ones(1500) for _ in range(4000)]
arrays = arrays[::50]
before = resident()
trimming()()
print(before - resident())
"""


@pytest.mark.skipif(trimming() is None or not Path("/proc/self/statm").exists(), reason="takes Linux and its C library")
def test_what_is_free_between_things_that_stay_goes_back() -> None:
    freed = int(subprocess.run([sys.executable, "-c", HOLES], capture_output=True, check=True).stdout)
    assert freed > 20e6


THREADS = """
import threading
from pathlib import Path
from coheft.wire.process.memory import give_back_memory

give_back_memory()
kept, gate = [], threading.Barrier(9)

def keep():
    gate.wait()
    kept.append([bytes(1000) for _ in range(1000)])
    gate.wait()

for _ in range(8):
    threading.Thread(target=keep, daemon=True).start()
gate.wait()
gate.wait()
maps = Path("/proc/self/maps").read_text().splitlines()
# The heap of a thread begins where 64 MB do.
print(sum(int(line.split("-")[0], 16) % 2**26 == 0 and "rw-p" in line for line in maps))
"""


@pytest.mark.skipif(trimming() is None or not Path("/proc/self/maps").exists(), reason="takes Linux and its C library")
def test_threads_share_one_heap() -> None:
    assert int(subprocess.run([sys.executable, "-c", THREADS], capture_output=True, check=True).stdout) == 0
    alone = THREADS.replace("\ngive_back_memory()\n", "\n")
    assert int(subprocess.run([sys.executable, "-c", alone], capture_output=True, check=True).stdout) > 0


LARGE = """
from pathlib import Path
import numpy as np
from coheft.app.run.parallel import _begin_worker
from coheft.wire.process.memory import give_back_memory, reuse_memory

def heap():
    line, = [line for line in Path("/proc/self/maps").read_text().splitlines() if line.endswith("[heap]")]
    return [int(end, 16) for end in line.split()[0].split("-")]

reuse_memory()
matrix = np.ones((700, 700))
first, last = heap()
print(first < matrix.ctypes.data < last)
del matrix
print(heap()[1] == last)
"""


@pytest.mark.skipif(trimming() is None or not Path("/proc/self/maps").exists(), reason="takes Linux and its C library")
@pytest.mark.parametrize(
    ("begin", "is_reused"),
    [("reuse_memory()", True), ("give_back_memory()", True), ("_begin_worker()", True), ("pass", False)],
)
def test_memory_of_a_large_matrix_stays_for_the_next_one(begin: str, is_reused: bool) -> None:
    script = LARGE.replace("\nreuse_memory()\n", f"\n{begin}\n")
    found = subprocess.run([sys.executable, "-c", script], capture_output=True, check=True).stdout.split()
    assert (found == [b"True", b"True"]) == is_reused
