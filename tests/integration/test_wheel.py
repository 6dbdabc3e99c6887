"""Wheel and sdist own one name, carry what they need, and run beside a distribution that owns ``agents``."""

from __future__ import annotations

import email
import os
import shutil
import subprocess
import sys
import tarfile
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest

import coheft

pytestmark = pytest.mark.smoke

ROOT = Path(__file__).parents[2]
NEEDED = (
    *("README.md", "LICENSE", "CHANGELOG.md", "CITATION.cff", "MANIFEST.in", "constraints.txt", "pyproject.toml"),
    *("coheft", "agents", "consensus", "physics_server", "configs"),
)
STUB = "stub_agents-1.0-py3-none-any.whl"


@pytest.fixture(scope="module")
def package(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with sdist and wheel: built from a copy, so that nothing that lies in ``build`` gets into them."""
    given = request.config.getoption("--package")
    if given is not None:
        return Path(given).resolve()
    source, folder = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("package")
    for name in NEEDED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, source / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(ROOT / name, source)
    build = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(source)]
    subprocess.run(build, check=True, capture_output=True)  # the wheel is built from the sdist
    return folder


@pytest.fixture(scope="module")
def wheel(package: Path) -> Path:
    (built,) = package.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def names(wheel: Path) -> list[str]:
    """What is in the wheel."""
    with zipfile.ZipFile(wheel) as file:
        return file.namelist()


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


def test_it_owns_one_name(names):
    assert {name.split("/")[0] for name in names if ".dist-info/" not in name} == {"coheft"}


def test_all_that_is_ours_and_needed_is_in_it(names):
    """Every module, scenario and data file of the clone, and nothing else."""
    expected = set[str]()
    for room in ("coheft", "agents", "consensus", "physics_server", "configs"):
        begin = room if room == "coheft" else f"coheft/{room}"
        for path in (ROOT / room).rglob("*"):
            parts = path.relative_to(ROOT / room).parts
            is_data = path.suffix in (".css", ".jinja", ".js", ".typed") or room == "configs"
            if path.is_file() and "__pycache__" not in parts and (path.suffix == ".py" or is_data):
                expected.add("/".join((begin, *parts)))
    assert {name for name in names if ".dist-info/" not in name} == expected


def test_the_sdist_has_what_belongs_to_it(package):
    (path,) = package.glob("*.tar.gz")
    with tarfile.open(path) as file:
        found = {name.partition("/")[2] for name in file.getnames()}
    assert {"LICENSE", "README.md", "CHANGELOG.md", "CITATION.cff", "constraints.txt", "pyproject.toml"} <= found
    assert "coheft/agents/agent.py" in found
    assert not any(name.startswith(("tests", "benchmarks", ".")) for name in found)


def test_it_says_what_it_is(wheel):
    with zipfile.ZipFile(wheel) as file:
        (name,) = (name for name in file.namelist() if name.endswith(".dist-info/METADATA"))
        metadata = email.message_from_bytes(file.read(name))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert metadata["Name"] == "coheft"
    assert metadata["Version"] == coheft.__version__
    assert metadata["License-Expression"] == "Apache-2.0"
    assert metadata["Description-Content-Type"] == "text/markdown"
    assert set(metadata.get_all("Provides-Extra", [])) == set(project["optional-dependencies"])
    citation = (ROOT / "CITATION.cff").read_text()
    assert f"\nversion: {coheft.__version__}\n" in citation
    assert "Decentralized and Recursive Identification" in citation


def test_it_runs_beside_another_owner_of_agents(wheel, tmp_path):
    site = tmp_path / "site"
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--target", str(site)]
    subprocess.run([*install, str(stub(tmp_path)), str(wheel)], check=True, capture_output=True)
    command = [sys.executable, "-P", "-m", "coheft", "run", "ring3", "--duration", "1", "--json", "-"]
    environment = {**os.environ, "PYTHONPATH": str(site)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=tmp_path, check=False)
    assert done.returncode == 3, done.stderr  # after a second no robot has converged
    assert '"scenario":' in done.stdout


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_it_runs_in_an_empty_environment_from_another_folder(wheel, tmp_path):
    """With what it says that it needs, and no more."""
    place = tmp_path / "environment"
    venv.create(place, with_pip=True)
    python = place / ("Scripts" if os.name == "nt" else "bin") / "python"
    constraints = str(ROOT / "constraints.txt")
    install = [str(python), "-m", "pip", "install", "--quiet", "--no-compile", "--constraint", constraints, str(wheel)]
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    installed = subprocess.run(install, capture_output=True, text=True, env=environment, check=False)
    if installed.returncode != 0:
        pytest.skip(f"needs a package index to install from: {installed.stderr.splitlines()[-1]}")
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    command = [str(python.with_name("coheft")), "run", "ring3", "--duration", "3"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=folder, check=False)
    assert done.returncode in (0, 3), done.stderr
    assert "What each robot found out about the payload" in done.stdout
    code = "import coheft; print(coheft.run('ring3', duration=2).robots['r1'].mass.estimate[-1])"
    done = subprocess.run([python, "-c", code], capture_output=True, text=True, env=environment, cwd=folder, check=True)
    assert float(done.stdout) == pytest.approx(5.0, rel=0.05)
