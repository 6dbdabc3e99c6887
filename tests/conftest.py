"""Settings and fixtures that all tests share."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from hypothesis import settings

# Matrices are small, and several tests may run at a time: more threads would only wait for each other.
os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"))

# Always the same examples, so a test that passed once passes everywhere; no deadline, because machines differ.
settings.register_profile("coheft", derandomize=True, deadline=None, max_examples=60, database=None)
settings.register_profile("fuzz", deadline=None, max_examples=2000, print_blob=True)  # for 'make fuzz': always others
settings.load_profile("coheft")

# Started in the background by a shell, tests would ignore Ctrl-C, and so would all runs that they start and interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def own_state_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The test does not see the runs of the user who runs it."""
    for name in ("XDG_STATE_HOME", "LOCALAPPDATA", "HOME"):
        monkeypatch.setenv(name, str(tmp_path / "state"))
