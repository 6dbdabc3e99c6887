"""Rerun opens recordings: it has the topics of robots and payload, by their names."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.recording.runs import news_of_a_run, record

RERUN = shutil.which("rerun")
pytestmark = [pytest.mark.slow, pytest.mark.skipif(RERUN is None, reason="takes rerun-sdk, whose command is 'rerun'")]


def test_rerun_reads_what_was_recorded(tmp_path: Path) -> None:
    recording, converted = record(tmp_path / "run.mcap", news_of_a_run()), tmp_path / "run.rrd"
    for command in (["mcap", "convert", str(recording), "-o", str(converted)], ["rrd", "stats", str(converted)]):
        done = subprocess.run([str(RERUN), *command], capture_output=True, text=True, timeout=100, check=False)
        assert done.returncode == 0, done.stderr
    for topic in ("/payload/inertia", "/payload/markers", "/r1/estimate/payload", "/r3/error/payload"):
        assert topic in done.stdout
