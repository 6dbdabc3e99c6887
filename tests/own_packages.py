"""Packages with estimators and motions of somebody's own, for tests: the example's, and broken ones."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

EXAMPLE = Path(__file__).parents[1] / "examples" / "own_estimator"


def install_example(folder: Path) -> Path:
    """Install the example as its README says, without network, into a folder for the path."""
    source, target = folder / "source", folder / "site"
    shutil.copytree(EXAMPLE, source, ignore=shutil.ignore_patterns("build", "*.egg-info", "__pycache__"))
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps"]
    done = subprocess.run(
        [*command, "--no-build-isolation", "--target", str(target), str(source)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return target


def write_package(folder: Path, name: str, code: str, *, estimators: str = "", motions: str = "") -> None:
    """A package of one module as an installer would leave it; entry points are lines such as ``mine = module:Mine``."""
    (folder / f"{name}.py").write_text(code)
    information = folder / f"{name}-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text(f"[coheft.estimators]\n{estimators}\n[coheft.motions]\n{motions}\n")
