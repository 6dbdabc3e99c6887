"""Free memory goes back to the system, also from between what stays."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from coheft.wire.memory import trimming

HOLES = """
import os
from pathlib import Path
import numpy as np
from coheft.wire.memory import trimming

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
