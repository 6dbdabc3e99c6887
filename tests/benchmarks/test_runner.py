"""One benchmark that fails does not take the others along."""

from __future__ import annotations

import pytest

from benchmarks import runner
from benchmarks.figures import Effort, Figure, Section
from coheft.errors import LinkError


def test_a_benchmark_that_fails_is_told(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def measure(name: str, effort: Effort) -> Section:
        if name == "floor":
            raise LinkError("no way\n  out")
        return Section(name=name, title=name, figures=[Figure(name="x", value=1.0)])

    monkeypatch.setattr(runner, "measure", measure)
    failed, fine = runner.measure_all(["floor", "kernels"], "short").sections
    assert not failed.figures
    assert [(each.name, each.reason) for each in failed.skipped] == [("all of it", "no way out")]
    assert fine.figures
    assert "kernels" in capsys.readouterr().err
