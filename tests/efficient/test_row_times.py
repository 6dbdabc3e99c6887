"""How blocks become rows, in small teams and in large ones."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.agents.efficient.row_times import OwnRows, RowTimes
from coheft.estimation.moments.rows import flexing, flexing_margin, row_of_samples, row_with_rates
from coheft.estimation.moments.sensor_errors import SensorErrors

RATE, GYRO_VARIANCE = 500.0, 1e-5
TIMES = [RowTimes(10, 10), RowTimes(12, 4), RowTimes(10, 30), RowTimes(4, 20)]


@pytest.mark.parametrize(
    ("count", "block", "rate", "row"),
    [
        (2, 10, 500, 10),
        (32, 10, 500, 10),
        (33, 10, 500, 20),
        (64, 10, 500, 20),
        (65, 10, 500, 30),
        (1000, 10, 500, 50),
        (48, 10, 250, 10),
        (6, 100, 1000, 20),
        (48, 100, 1000, 25),
        (100, 100, 1000, 50),
        (6, 200, 1000, 20),
        (100, 8, 500, 40),
        (6, 2, 100, 2),
        (6, 3, 1000, 18),
    ],
)
def test_rows_are_short_and_grow_with_the_team(count: int, block: int, rate: float, row: int) -> None:
    assert RowTimes.of_team(count, block, rate) == RowTimes(block, row)


@pytest.mark.parametrize("times", TIMES)
def test_rows_begin_and_end_where_their_samples_are(times: RowTimes) -> None:
    for number in range(40):
        samples = np.arange(number * times.row, (number + 1) * times.row)
        assert times.first_block(number) == samples[0] // times.block
        assert times.last_block(number) == samples[-1] // times.block
        assert times.complete(times.last_block(number)) > number
        assert times.complete(times.last_block(number) - 1) <= number
        assert times.begun_from(samples[0] // times.block) <= number < times.begun_from(samples[0] // times.block + 10)
    for block in range(40):
        assert times.begun_from(block) * times.row >= block * times.block
        assert (times.begun_from(block) - 1) * times.row < block * times.block


@pytest.mark.parametrize("times", TIMES)
def test_rows_are_of_consecutive_samples(times: RowTimes) -> None:
    blocks = np.random.default_rng(1).normal(size=(30, times.block, 15))
    samples = blocks.reshape(-1, 15)
    rows, own = list[int](), OwnRows(times, GYRO_VARIANCE, RATE, SensorErrors({}))
    for index, block in enumerate(blocks):
        for number, row in own.add(index, block):
            assert times.last_block(number) == index
            expected = row_of_samples(samples[number * times.row :][: times.row], GYRO_VARIANCE, RATE)
            np.testing.assert_array_equal(row, expected)
            rows.append(number)
    assert rows == list(range(len(samples) // times.row))


@pytest.mark.parametrize("times", TIMES)
def test_of_a_row_of_which_samples_are_missing_there_is_none(times: RowTimes) -> None:
    blocks, missing = np.random.default_rng(1).normal(size=(30, times.block, 15)), {0, 7, 8, 20}
    own = OwnRows(times, GYRO_VARIANCE, RATE, SensorErrors({}))
    found = [number for index in range(30) if index not in missing for number, _ in own.add(index, blocks[index])]
    for number in range(30 * times.block // times.row):
        blocks_of = {sample // times.block for sample in range(number * times.row, (number + 1) * times.row)}
        assert (number in found) == blocks_of.isdisjoint(missing)


@pytest.mark.parametrize("times", TIMES)
@pytest.mark.parametrize(
    "kinds", [{"clock": 1e-3}, {"grasp_compliance": 1e-5}, {"clock": 1e-3, "grasp_compliance": 1e-5}]
)
def test_what_follows_rows_is_of_samples_before_and_after_them(times: RowTimes, kinds: dict[str, float]) -> None:
    blocks, errors = np.random.default_rng(1).normal(size=(60, times.block, 15)), SensorErrors(kinds)
    samples, own = blocks.reshape(-1, 15), OwnRows(times, GYRO_VARIANCE, RATE, errors)
    margin, found = flexing_margin(RATE) if errors.is_flexing else 1, list[int]()
    for index, block in enumerate(blocks):
        for number, row in own.add(index, block):
            found.append(number)
            first = number * times.row - margin
            parts = [row_of_samples(samples[first : first + times.row], GYRO_VARIANCE, RATE)]
            if errors.has_rates:
                parts = [row_with_rates(samples[first - 1 : first + times.row + 1], GYRO_VARIANCE, RATE)]
            if errors.is_flexing:
                parts.append(flexing(samples[first - margin : first + times.row + margin], margin, RATE))
            np.testing.assert_array_equal(row, np.concatenate(parts))
    assert found == list(range(-(-2 * margin // times.row), len(samples) // times.row))
