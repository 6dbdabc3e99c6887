"""The wheel owns one name, carries what it needs, and runs beside a distribution that owns ``agents``."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.smoke

ROOT = Path(__file__).parents[2]
NEEDED = ("README.md", "LICENSE", "pyproject.toml", "coheft", "agents", "consensus", "physics_server", "configs")
STUB = "stub_agents-1.0-py3-none-any.whl"


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built from a copy, so that nothing that lies in ``build`` gets into it."""
    source, folder = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheel")
    for name in NEEDED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, source / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(ROOT / name, source)
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
    subprocess.run([*build, "--wheel-dir", str(folder), str(source)], check=True, capture_output=True)
    (built,) = folder.glob("*.whl")
    return built


def stub(folder: Path) -> Path:
    """A wheel that owns the name ``agents``, and fails whoever takes it for ours."""
    path, info = folder / STUB, "stub_agents-1.0.dist-info"
    with zipfile.ZipFile(path, "w") as file:
        for name in ("agents", "consensus", "physics_server"):
            file.writestr(f"{name}/__init__.py", f"raise RuntimeError('the {name} of another distribution')\n")
        file.writestr(f"{info}/METADATA", "Metadata-Version: 2.1\nName: stub-agents\nVersion: 1.0\n")
        file.writestr(
            f"{info}/WHEEL", "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
        )
        file.writestr(f"{info}/RECORD", "")
    return path


def test_it_owns_one_name(wheel):
    with zipfile.ZipFile(wheel) as file:
        names = file.namelist()
    assert {name.split("/")[0] for name in names if ".dist-info/" not in name} == {"coheft"}
    for part in (
        "agents/agent.py",
        "consensus/gossip.py",
        "physics_server/server.py",
        "configs/ring6.toml",
        "py.typed",
    ):
        assert f"coheft/{part}" in names


def test_it_runs_beside_another_owner_of_agents(wheel, tmp_path):
    site = tmp_path / "site"
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--target", str(site)]
    subprocess.run([*install, str(stub(tmp_path)), str(wheel)], check=True, capture_output=True)
    command = [sys.executable, "-P", "-m", "coheft", "run", "ring3", "--duration", "1", "--json", "-"]
    environment = {**os.environ, "PYTHONPATH": str(site)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=tmp_path, check=False)
    assert done.returncode == 3, done.stderr  # after a second no robot has converged
    assert '"scenario":' in done.stdout
