"""The regression guard: ratios as they were against ratios as they are."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from benchmarks.compare import LIMIT, Committed, better_of, compare, load_committed, write_committed
from benchmarks.figures import Figure
from coheft.errors import CoheftError


def cost(value: float) -> Figure:
    return Figure(name="cost", value=value)


def speed(value: float) -> Figure:
    return Figure(name="speed", value=value, more_is_better=True)


def test_a_cost_is_worse_when_it_grows_and_a_speed_when_it_falls() -> None:
    committed = {"cost": Committed(2.0), "speed": Committed(30.0, more_is_better=True)}
    within = compare(committed, {"cost": cost(2.0 * LIMIT - 0.01), "speed": speed(30.0 / LIMIT + 0.01)})
    assert not any(each.is_regression for each in within)
    beyond = compare(committed, {"cost": cost(2.0 * LIMIT + 0.01), "speed": speed(30.0 / LIMIT - 0.01)})
    assert all(each.is_regression for each in beyond)
    better = compare(committed, {"cost": cost(0.1), "speed": speed(300.0)})
    assert not any(each.is_regression for each in better)


def test_the_worst_comes_first_and_says_what_was_and_is() -> None:
    committed = {"a": Committed(1.0), "b": Committed(1.0)}
    first, second = compare(committed, {"a": cost(1.1), "b": cost(1.5)})
    assert str(first) == "b: was 1, is 1.5, 1.50 times as bad"
    assert second.name == "a"


def test_what_is_not_measured_any_more_is_a_regression() -> None:
    (only,) = compare({"gone": Committed(1.0)}, {})
    assert only.is_regression
    assert only.worse == math.inf
    assert str(only) == "gone: was 1, was not measured"


def test_a_figure_that_is_no_number_is_a_regression() -> None:
    (only,) = compare({"cost": Committed(1.0)}, {"cost": cost(math.nan)})
    assert only.is_regression


def test_of_two_measurements_the_better_one_counts() -> None:
    first = {"cost": cost(2.0), "speed": speed(20.0), "once": cost(1.0)}
    second = {"cost": cost(1.5), "speed": speed(15.0)}
    assert better_of(first, second) == {"cost": cost(1.5), "speed": speed(20.0), "once": cost(1.0)}


def test_committed_ratios_survive_their_file(tmp_path: Path) -> None:
    path = tmp_path / "ratios.json"
    write_committed({"cost": cost(1.23456), "speed": speed(20.0)}, path)
    assert load_committed(path) == {"cost": Committed(1.235), "speed": Committed(20.0, more_is_better=True)}


def test_a_missing_or_broken_file_is_told(tmp_path: Path) -> None:
    with pytest.raises(CoheftError, match="--commit"):
        load_committed(tmp_path / "none.json")
    (tmp_path / "broken.json").write_text("[]")
    with pytest.raises(CoheftError, match="not a table of ratios"):
        load_committed(tmp_path / "broken.json")


def test_the_shipped_ratios_can_be_read() -> None:
    committed = load_committed()
    assert committed
    assert all(each.value > 0.0 for each in committed.values())
