"""Figures become tables that say what misses its bar."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.figures import Figure, Machine, Results, Section, digits, guarded, load_results
from coheft.errors import CoheftError

FAST = Figure(name="speed", value=12.345, unit="times real time", bar=15.0, more_is_better=True, note="busy machine")
LEAN = Figure(name="memory", value=51.0, unit="MB", bar=60.0)
RATIO = Figure(name="against floor", value=1.75, bar=1.8, is_guarded=True)
SECTION = Section(name="floor", title="Against the floor", figures=[FAST, LEAN, RATIO], skipped={"x": "no y"})
RESULTS = Results(
    effort="short",
    machine=Machine(cores=2, python="3.11.7", numpy="2.0.0", load_before=0.5, load_after=2.0),
    sections=[SECTION],
)


def test_a_bar_can_be_above_or_below() -> None:
    assert FAST.misses_bar
    assert not LEAN.misses_bar
    assert not RATIO.misses_bar
    assert Figure(name="memory", value=61.0, bar=60.0).misses_bar
    assert not Figure(name="memory", value=61.0).misses_bar


def test_the_table_shows_what_misses_its_bar_and_what_was_not_measured() -> None:
    table = RESULTS.markdown()
    assert "| speed | **12.3 times real time** | ≥ 15 | busy machine |" in table
    assert "| memory | 51 MB | ≤ 60 |  |" in table
    assert "- not measured: x: no y" in table
    assert "load average 0.5 before, 2.0 after" in table


def test_both_files_hold_the_same(tmp_path: Path) -> None:
    table, data = RESULTS.write(tmp_path / "new" / "folder")
    assert table.read_text(encoding="utf-8") == RESULTS.markdown()
    assert load_results(data) == RESULTS
    with pytest.raises(CoheftError, match="not a bench"):
        load_results(table)
    with pytest.raises(CoheftError, match="python -m benchmarks"):
        load_results(tmp_path / "none.json")


def test_only_ratios_that_say_so_are_guarded() -> None:
    assert guarded([SECTION]) == {"floor: against floor": 1.75}


def test_numbers_are_readable() -> None:
    shown = [digits(value) for value in (0.0, 3.0, 0.01234, 1.2345, 123.4, 54_321.0, 1e-9, 3.5e7)]
    assert shown == ["0", "3", "0.0123", "1.23", "123", "54,321", "1.0e-09", "3.5e+07"]
