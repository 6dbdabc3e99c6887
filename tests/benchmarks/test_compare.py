"""The regression guard: ratios as they were against ratios as they are."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from benchmarks import check
from benchmarks.check import LIMIT, compare, load_committed, write_committed
from benchmarks.figures import Figure, Section
from coheft.errors import CoheftError


def test_a_ratio_is_worse_when_it_grows() -> None:
    for now, is_regression in ((2.0 * LIMIT - 0.01, False), (2.0 * LIMIT + 0.01, True), (0.1, False)):
        (only,) = compare({"cost": 2.0}, {"cost": now})
        assert only.is_regression == is_regression


def test_the_worst_comes_first_and_says_what_was_and_is() -> None:
    first, second = compare({"a": 1.0, "b": 1.0}, {"a": 1.1, "b": 1.5})
    assert str(first) == "b: was 1, is 1.5, 1.50 times as bad"
    assert second.name == "a"


def test_what_is_not_measured_any_more_is_a_regression() -> None:
    gone, there = compare({"there": 1.0, "gone": 1.0}, {"there": 9.0})
    assert gone.is_regression
    assert str(gone) == "gone: was 1, was not measured"
    assert there.name == "there"


def test_a_ratio_that_is_no_number_is_a_regression() -> None:
    (only,) = compare({"cost": 1.0}, {"cost": math.nan})
    assert only.is_regression


@pytest.mark.parametrize(("second", "status"), [(1.0, 0), (3.0, 1)])
def test_what_is_worse_is_measured_once_more(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], second: float, status: int
) -> None:
    values = iter((2.0, second))

    def measure_all(names: list[str], effort: str) -> list[Section]:
        cost = Figure(name="cost", value=next(values), is_guarded=True)
        return [Section(name="floor", title="", figures=[cost])]

    monkeypatch.setattr(check, "measure_all", measure_all)
    monkeypatch.setattr(check, "load_committed", lambda: {"floor: cost": 1.0})
    assert check.check() == status
    output = capsys.readouterr()
    assert "once more" in output.err
    assert f"is {min(2.0, second):.3g}" in output.out


def test_committed_ratios_survive_their_file(tmp_path: Path) -> None:
    path = tmp_path / "ratios.json"
    write_committed({"cost": 1.23456, "other": 20.0}, path)
    assert load_committed(path) == {"cost": 1.235, "other": 20.0}


def test_a_missing_or_broken_file_is_told(tmp_path: Path) -> None:
    with pytest.raises(CoheftError, match="--commit"):
        load_committed(tmp_path / "none.json")
    (tmp_path / "broken.json").write_text("[]")
    with pytest.raises(CoheftError, match="not a table of ratios"):
        load_committed(tmp_path / "broken.json")


def test_the_shipped_ratios_can_be_read() -> None:
    committed = load_committed()
    assert committed
    assert all(value > 0.0 for value in committed.values())
