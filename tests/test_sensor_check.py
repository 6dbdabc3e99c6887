"""Sensors that fail are found out, whichever they are; those that work are believed, whatever happens to the load."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coheft.agents.sensor_check import SensorCheck
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import SAMPLE_SIZE, SensorNoise
from tests.estimation.team import make_team

NOISE = SensorNoise()
SENSORS = ("gyro", "velocity", "accelerometer", "force", "torque")
BLOCK = 10
RATE = 500.0
columns = pytest.mark.parametrize("column", range(SAMPLE_SIZE), ids=lambda k: f"{SENSORS[k // 3]}-{'xyz'[k % 3]}")


def samples(blocks: int, seed: int = 1, size: int = BLOCK) -> Array:
    """What working sensors read of a load that is moved, shape (blocks, size, 15)."""
    exact = make_team(seed, count=2, rate=RATE, duration=blocks * size / RATE).exact[:, 1]
    noise = np.random.default_rng(seed).normal(size=exact.shape) * NOISE.per_column()
    return (exact + noise)[: blocks * size].reshape(blocks, size, SAMPLE_SIZE)


def work(blocks: Array) -> list[bool]:
    check = SensorCheck(NOISE)
    return [check.is_usable(block) for block in blocks]


@given(st.integers(0, 10**6), st.integers(3, 12), st.integers(1, 4), st.data())
def test_working_sensors_are_believed_even_when_a_load_drops(
    seed: int, size: int, block: int, data: st.DataObject
) -> None:
    at = data.draw(st.integers(0, size - 1))
    blocks = samples(6, seed, size)
    step = 1e3 * np.random.default_rng(seed).normal(size=SAMPLE_SIZE) * NOISE.per_column()
    blocks.reshape(-1, SAMPLE_SIZE)[block * size + at :] += step
    expected = 6 * [True]
    # At the end of a block one cannot tell yet whether it will stay like that.
    expected[block] = at < size - 1
    assert work(blocks) == expected


@columns
def test_a_sudden_change_that_overshoots_is_believed(column: int) -> None:
    blocks = samples(3)
    blocks[1, 4, column] += 100.0 * NOISE.per_column()[column]
    blocks.reshape(-1, SAMPLE_SIZE)[BLOCK + 5 :, column] += 80.0 * NOISE.per_column()[column]
    assert work(blocks) == [True, True, True]


@columns
@pytest.mark.parametrize("size", [-1e3, 40.0])
def test_an_outlier_is_found_wherever_it_is(column: int, size: float) -> None:
    for at in range(BLOCK):
        blocks = samples(4)
        blocks[1, at, column] += size * NOISE.per_column()[column]
        assert work(blocks) == [True, False, True, True], at


@columns
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e7])
@pytest.mark.parametrize("at", [4, BLOCK - 1])
def test_what_is_no_number_or_out_of_range_is_found_and_spoils_nothing_else(column: int, at: int, value: float) -> None:
    blocks = samples(3)
    blocks[1, at, column] = value
    assert work(blocks) == [True, False, True]


@columns
@pytest.mark.parametrize("factor", [1e9, -1e77, 1e300])
def test_what_no_sensor_can_read_is_found(column: int, factor: float) -> None:
    blocks = samples(3)
    blocks[1, BLOCK // 2 :, column] *= factor
    assert work(blocks)[1] is False


@pytest.mark.parametrize("sensor", range(5), ids=SENSORS)
@pytest.mark.parametrize("until", [1, 3])
def test_a_sensor_that_is_frozen_for_a_few_samples_more_is_not_believed_yet(sensor: int, until: int) -> None:
    blocks = samples(4)
    axes = slice(3 * sensor, 3 * sensor + 3)
    blocks[1, :, axes] = blocks[2, :until, axes] = blocks[1, 0, axes]
    assert work(blocks) == [True, False, False, True]


@pytest.mark.parametrize("sensor", range(5), ids=SENSORS)
@pytest.mark.parametrize("since", [0, 4, BLOCK - 3])
def test_a_frozen_sensor_is_found_even_if_it_froze_within_the_block(sensor: int, since: int) -> None:
    blocks = samples(4)
    axes = slice(3 * sensor, 3 * sensor + 3)
    blocks[1, since:, axes] = blocks[2, :, axes] = blocks[1, since, axes]
    assert work(blocks) == [True, False, False, True]


@columns
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_one_axis_at_its_limit_is_found(column: int, sign: float) -> None:
    blocks = samples(4)
    limit = np.sort(sign * blocks[1, :, column])[2]
    blocks[..., column] = sign * np.minimum(sign * blocks[..., column], limit)
    assert not work(blocks)[1]


def test_an_arm_at_rest_without_noise_is_believed() -> None:
    blocks = samples(3)
    blocks[:, :, :6] = 0.0
    assert work(blocks) == [True, True, True]


@pytest.mark.parametrize("sensor", range(5), ids=SENSORS)
def test_what_is_wrong_is_told_from_the_second_block_on_until_one_is_right(sensor: int) -> None:
    blocks = samples(5)
    blocks[1:4, 3, 3 * sensor] = np.nan
    check, told = SensorCheck(NOISE), []
    for block in blocks:
        check.is_usable(block)
        told.append(check.fault)
    # The sample before the last block was right, so it is as well.
    assert told == [None, None, *2 * [f"the {SENSORS[sensor]} is not a finite number"], None]


@given(st.integers(0, 10**6), st.permutations(range(3)), st.sampled_from([-1.0, 1.0]), st.booleans())
def test_axes_have_no_names_and_no_signs(seed: int, order: list[int], sign: float, is_spoilt: bool) -> None:
    blocks = samples(3, seed)
    rng = np.random.default_rng(seed)
    if is_spoilt:
        column = rng.integers(SAMPLE_SIZE)
        blocks[1, rng.integers(BLOCK), column] += 100.0 * NOISE.per_column()[column]
    turned = sign * blocks.reshape(3, BLOCK, 5, 3)[..., order].reshape(blocks.shape)
    assert work(turned) == work(blocks) == [True, not is_spoilt, True]
