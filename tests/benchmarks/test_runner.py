"""A benchmark that fails, or is broken off, does not take the others along."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import __main__ as command
from benchmarks import runner
from benchmarks.figures import Effort, Figure, Section, load_results
from coheft.errors import LinkError

ERRORS: dict[str, BaseException] = {
    "floor": LinkError("no way\n  out"),
    "startup": subprocess.CalledProcessError(3, "python"),
    "secure": KeyboardInterrupt(),
}


@pytest.fixture(autouse=True)
def _measured_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    def measure(name: str, effort: Effort) -> Section:
        if name in ERRORS:
            raise ERRORS[name]
        skipped = {"all of it": "it takes too long"} if name == "realtime" else {}
        return Section(name=name, title=name, figures=[Figure(name="x", value=1.0)], skipped=skipped)

    monkeypatch.setattr(runner, "measure", measure)


def run(monkeypatch: pytest.MonkeyPatch, folder: Path, *names: str) -> int | str | None:
    """The exit status of the command."""
    monkeypatch.setattr(sys, "argv", ["benchmarks", *names, "--to", str(folder)])
    with pytest.raises(SystemExit) as ended:
        command.main()
    return ended.value.code


def test_a_benchmark_that_fails_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, tmp_path, "floor", "startup", "realtime") == 1
    floor, startup, fine = load_results(tmp_path / "bench.json").sections
    assert not floor.figures
    assert floor.skipped == {"all of it": "no way out"}
    assert startup.skipped["all of it"].startswith("CalledProcessError: Command 'python' returned non-zero")
    assert fine.figures
    output = capsys.readouterr()
    assert "- not measured: all of it: no way out" in output.out
    assert "realtime" in output.err
    assert "Traceback" in output.err


def test_what_was_left_out_has_not_failed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert run(monkeypatch, tmp_path, "realtime") == 0


def test_what_was_measured_before_ctrl_c_is_written(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert run(monkeypatch, tmp_path, "realtime", "secure", "floor") == 130
    assert [section.name for section in load_results(tmp_path / "bench.json").sections] == ["realtime"]
