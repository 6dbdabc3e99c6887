"""Ratios of interleaved measurements. No test here depends on how fast anything is."""

from __future__ import annotations

import pytest

from benchmarks import timing
from benchmarks.timing import interleaved, ratio


def test_the_ratio_is_the_median_of_each_rounds_own() -> None:
    assert ratio([2.0, 20.0, 3.0], [1.0, 10.0, 1.0]) == 2.0  # the machine was ten times slower in the second round


def test_as_many_rounds_of_both() -> None:
    with pytest.raises(ValueError, match="zip"):
        ratio([1.0, 2.0], [1.0])


def test_candidates_take_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timing, "LEAST", 0.0)
    called: list[str] = []
    times = interleaved({"a": lambda: called.append("a"), "b": lambda: called.append("b")}, rounds=3)
    assert called[-6:] == ["a", "b", "a", "b", "a", "b"]
    assert {name: len(each) for name, each in times.items()} == {"a": 3, "b": 3}
