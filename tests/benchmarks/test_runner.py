"""A benchmark that fails, or is broken off, does not take the others along."""

from __future__ import annotations

import subprocess
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


def test_a_benchmark_that_fails_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main("floor", "startup", "realtime", to=tmp_path) == 1
    floor, startup, fine = load_results(tmp_path / "bench.json").sections
    assert not floor.figures
    assert floor.skipped == {"all of it": "no way out"}
    assert startup.skipped["all of it"].startswith("CalledProcessError: Command 'python' returned non-zero")
    assert fine.figures
    output = capsys.readouterr()
    assert "- not measured: all of it: no way out" in output.out
    assert "realtime" in output.err
    assert "Traceback" in output.err


def test_what_was_left_out_has_not_failed(tmp_path: Path) -> None:
    assert command.main("realtime", to=tmp_path) == 0


def test_what_was_measured_before_ctrl_c_is_written(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        command.main("realtime", "secure", "floor", to=tmp_path)
    assert [section.name for section in load_results(tmp_path / "bench.json").sections] == ["realtime"]
