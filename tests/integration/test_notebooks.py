"""The notebooks of ``examples`` run from beginning to end, and hold no output that would grow old."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

# They are imported by tests only: each worker imports this file, also to run none of its tests.
MISSING = [name for name in ("nbclient", "nbformat", "ipykernel", "matplotlib", "pandas") if find_spec(name) is None]
pytestmark = pytest.mark.skipif(bool(MISSING), reason=f"takes {', '.join(MISSING)}")

NOTEBOOKS = sorted((Path(__file__).parents[2] / "examples" / "notebooks").glob("*.ipynb"))


def texts(notebook: Any) -> str:
    """All that its cells print or return."""
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    return "\n".join(output.get("text", "") or output.get("data", {}).get("text/plain", "") for output in outputs)


def run(name: str, folder: Path) -> Any:
    import nbclient
    import nbformat

    (path,) = (path for path in NOTEBOOKS if path.stem == name)
    notebook = nbformat.read(path, as_version=4)
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(folder)}}).execute()
    return notebook


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_is_kept_without_outputs(path: Path) -> None:
    import nbformat

    for cell in nbformat.read(path, as_version=4).cells:
        assert not cell.get("outputs"), "clear all outputs before you commit"


@pytest.mark.filterwarnings("default")  # those of jupyter's own packages
@pytest.mark.timeout(600)
def test_a_first_run(tmp_path: Path) -> None:
    notebook = run("first_run", tmp_path)
    printed = texts(notebook)
    assert "finding neighbours -> converged" in printed
    assert "r1 has noticed the load at 4." in printed
    assert "key 'payload.boxes[0].mass': expected a number greater than 0" in printed
    assert "robot.setLoad(5.0" in printed or "robot.setLoad(4.9" in printed
    pictures = [
        output for cell in notebook.cells for output in cell.get("outputs", []) if "image/png" in output.get("data", {})
    ]
    assert len(pictures) == 2


@pytest.mark.filterwarnings("default")
@pytest.mark.timeout(600)
def test_measurements_of_one_s_own(tmp_path: Path) -> None:
    printed = texts(run("own_measurements", tmp_path))
    assert "likelihood [] []" in printed
    assert "10.0 s  valid" in printed
    assert "stale [" in printed.splitlines()[-1], "a wrong sensor is noticed"
