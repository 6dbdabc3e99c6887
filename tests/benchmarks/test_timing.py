"""Ratios of measurements that took turns. No test here depends on how fast anything is."""

from __future__ import annotations

import pytest

from benchmarks.figures import ratio


def test_the_ratio_is_the_median_of_each_rounds_own() -> None:
    assert ratio([2.0, 20.0, 3.0], [1.0, 10.0, 1.0]) == 2.0  # the machine was ten times slower in the second round


def test_as_many_rounds_of_both() -> None:
    with pytest.raises(ValueError, match="zip"):
        ratio([1.0, 2.0], [1.0])
