"""What ``make`` installs for what."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MAKE = shutil.which("make")

pytestmark = pytest.mark.skipif(MAKE is None, reason="there is no make")


def planned(folder: Path, target: str) -> str:
    """What would be done in a folder."""
    assert MAKE is not None
    return subprocess.run([MAKE, "-n", target], cwd=folder, capture_output=True, text=True, check=True).stdout


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        shutil.copyfile(ROOT / name, tmp_path / name)
    return tmp_path


def test_the_demo_installs_what_a_run_needs_and_says_so(clone: Path) -> None:
    todo = planned(clone, "demo")
    assert "'.[view]'" in todo
    assert "dev" not in todo
    assert "Installing what a run needs into .venv" in todo


@pytest.mark.parametrize("target", ["setup", "test", "check", "docs"])
def test_all_else_installs_everything(target: str, clone: Path) -> None:
    assert "'.[dev]'" in planned(clone, target)


def test_nothing_is_installed_twice(clone: Path) -> None:
    (clone / ".venv").mkdir()
    (clone / ".venv" / "runtime").touch()
    assert "pip" not in planned(clone, "demo")
    assert "'.[dev]'" in planned(clone, "test")
    (clone / ".venv" / "installed").touch()
    assert "pip" not in planned(clone, "test")
