"""Sums of samples since borders, held against sums of all samples one by one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coheft.estimation.spatial import Array
from coheft.estimation.stretches import Stretches

SIZE = 3


def blocks(count: int) -> Array:
    return np.random.default_rng(8).normal(size=(count, SIZE))


def fed(values: Array, first: int = 0) -> Stretches:
    stretches = Stretches(SIZE, resolution=8)
    for block, value in enumerate(values, start=first):
        stretches.push(block, value)
    return stretches


def doubled(sums: Array) -> Array:
    changed: Array = sums * [1.0, 2.0, 2.0]
    return changed


def test_borders_grow_with_the_logarithm_and_are_dense_among_the_newest() -> None:
    counts = {count: len(fed(np.ones((count, SIZE)))) for count in (2048, 4096)}
    assert counts[4096] - counts[2048] <= 10
    assert counts[4096] < 100
    ages = 4096 - fed(np.ones((4096, SIZE))).firsts
    assert ages[0] == 4096
    assert set(range(1, 17)) <= set(ages.tolist())
    assert np.all(ages[:-1] - ages[1:] <= 1 + ages[:-1] / 8)


def test_all_borders_hold_the_sums_of_what_came_after_them() -> None:
    stretches, brute = Stretches(SIZE, resolution=8), {}
    for block, value in enumerate(blocks(300)):
        stretches.push(block, value)
        brute[block] = value.copy()
        if block % 70 == 35:
            stretches.revise(doubled)
            brute = {k: doubled(each) for k, each in brute.items()}
        if block == 150:
            stretches.forget_before(80)
        if block == 220:
            before = stretches.firsts.copy()
            stretches.forget_borders_before(200)
            assert stretches.firsts[0] == before[0]
            np.testing.assert_array_equal(stretches.firsts[1:], before[before >= 200])
        if block % 50 == 49:
            expected = [sum(brute[k] for k in range(first, block + 1)) for first in stretches.firsts]
            np.testing.assert_allclose(stretches.sums, expected, rtol=1e-9, atol=1e-9)
            np.testing.assert_array_equal(stretches.total, stretches.sums[0])
    assert stretches.firsts[0] == 80


@given(st.integers(2, 200), st.data())
def test_what_is_taken_back_was_never_there(count: int, data: st.DataObject) -> None:
    values = blocks(count)
    stretches = fed(values)
    since = data.draw(st.integers(0, count - 1))
    kept = int(stretches.firsts[stretches.firsts <= since].max())
    stretches.forget_since(since)
    assert len(stretches) == len(fed(values).firsts[fed(values).firsts < kept])
    np.testing.assert_allclose(stretches.total, values[:kept].sum(axis=0), atol=1e-9)


def test_early_blocks_count_as_if_they_had_come_in_time() -> None:
    values = blocks(160)
    in_time, early = fed(values), fed(values[80:], first=80)
    for block in reversed(range(80)):
        assert early.push_early(block, values[block])
    assert early.firsts[0] == 0
    assert early.count == 80
    np.testing.assert_allclose(early.total, in_time.total, rtol=1e-9)
    assert not Stretches(SIZE, resolution=8).push_early(3, values[0])


@pytest.mark.parametrize("neighbours", [1, 3])
def test_joined_stretches_are_what_lies_between_borders(neighbours: int) -> None:
    values = blocks(50)
    stretches = fed(values)
    firsts = stretches.firsts
    expected = [values[a:b].sum(axis=0) for a, b in zip(firsts, firsts[neighbours:], strict=False)]
    np.testing.assert_allclose(stretches.joined(neighbours), expected, atol=1e-9)
