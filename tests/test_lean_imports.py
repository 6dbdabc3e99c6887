"""What a process does not need it does not load: there is one per robot, on machines that may be small."""

from __future__ import annotations

import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    ("module", "heavy"),
    [
        ("agents.process", {"scipy", "mujoco", "physics_server", "cyclopts", "rich", "unittest", "coheft.wire.cart"}),
        ("physics_server.server", {"agents", "cyclopts", "rich", "matplotlib"}),
        ("coheft.app.cli", {"zenoh", "mujoco", "numpy", "scipy", "matplotlib", "joblib"}),
    ],
)
def test_what_is_not_loaded(module, heavy):
    code = f"import {module}, sys; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert heavy & set(loaded) == set()
