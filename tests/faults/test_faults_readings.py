"""What faulty sensors and clocks make of measurements: just what was asked for, in those samples and no others."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from coheft.app.faults.readings import Readings
from coheft.app.faults.schedule import ClockSkew, FaultSchedule, RobotFault, Sensor, SensorFailure, SensorFault
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import ACCELERATION, FORCE, GYRO
from tests.faults.drawn import plain

BLOCKS = 50
SCHEDULE = plain(0)
SIZE, PERIOD = SCHEDULE.scenario.sensors.block, SCHEDULE.scenario.block_duration
TRUE = np.random.default_rng(4).normal(scale=30.0, size=(BLOCKS * SIZE, 15))
FIRST, END = 10 * SIZE + 1, 30 * SIZE - 1
"""Samples from the first on and before the last are hit: a fault begins and ends in the middle of a block."""
HIT = slice(FIRST, END)


def schedule(*faults: RobotFault) -> FaultSchedule:
    return msgspec.structs.replace(SCHEDULE, faults=faults)


def read(*faults: RobotFault, robot: str = "r1") -> Array:
    """All samples as they reach an agent."""
    readings = Readings(schedule(*faults), robot)
    blocks = TRUE.reshape(BLOCKS, SIZE, 15)
    return np.concatenate([readings.read(block, samples) for block, samples in enumerate(blocks)])


def fault(how: SensorFailure, size: float, sensor: Sensor = "force") -> SensorFault:
    moment = PERIOD / SIZE
    return SensorFault(robot="r1", sensor=sensor, how=how, size=size, seed=5, start=FIRST * moment, end=END * moment)


def test_a_fault_of_another_robot_changes_nothing() -> None:
    faults = fault("nan", 1.0), ClockSkew(robot="r1", start=0.0, end=9.0, samples=3)
    np.testing.assert_array_equal(read(*faults, robot="r2"), TRUE)


@pytest.mark.parametrize(
    ("how", "size"), [("nan", 0.5), ("frozen", 1.0), ("outliers", 0.5), ("saturation", 0.5), ("offset", 8.0)]
)
def test_a_fault_hits_its_sensor_while_it_lasts(how: SensorFailure, size: float) -> None:
    found = read(fault(how, size))
    is_changed = ~(found == TRUE)
    assert is_changed[HIT, FORCE].any()
    is_changed[HIT, FORCE] = False
    assert not is_changed.any()


def test_a_share_of_the_samples_is_no_number() -> None:
    missing = np.isnan(read(fault("nan", 0.3))[HIT, FORCE])
    assert (missing.all(axis=1) == missing.any(axis=1)).all(), "a sample is there or not"
    assert missing[:, 0].mean() == pytest.approx(0.3, abs=0.15)


def test_a_frozen_sensor_repeats_what_it_read_last() -> None:
    last = np.tile(TRUE[FIRST - 1, FORCE], (END - FIRST, 1))
    np.testing.assert_array_equal(read(fault("frozen", 1.0))[HIT, FORCE], last)


def test_outliers_are_some_samples_that_are_far_off() -> None:
    off = (read(fault("outliers", 0.3, "gyro")) - TRUE)[HIT, GYRO]
    hit = off.any(axis=1)
    assert hit.mean() == pytest.approx(0.3, abs=0.15)
    assert 1.0 < np.abs(off).max() < 5.0 + 1e-9, "10 times the 0.5 rad/s that gyros usually read"


def test_a_saturated_sensor_reads_no_more_than_its_limit() -> None:
    np.testing.assert_array_equal(read(fault("saturation", 0.5))[HIT, FORCE], np.clip(TRUE[HIT, FORCE], -15.0, 15.0))


def test_an_offset_is_the_same_all_along() -> None:
    off = (read(fault("offset", 8.0, "acceleration")) - TRUE)[HIT, ACCELERATION]
    noise = SCHEDULE.scenario.noise.per_column()[ACCELERATION]
    np.testing.assert_allclose(np.abs(off), np.tile(8.0 * noise, (END - FIRST, 1)), rtol=1e-9)
    np.testing.assert_allclose(off, np.tile(off[0], (END - FIRST, 1)), rtol=1e-9)


def test_late_samples_are_those_of_before_until_the_clock_is_right_again() -> None:
    first, end = 10, 30
    found = read(ClockSkew(robot="r1", start=first * PERIOD, end=end * PERIOD, samples=3))
    late = slice(first * SIZE, end * SIZE)
    np.testing.assert_array_equal(found[late], TRUE[first * SIZE - 3 : end * SIZE - 3])
    np.testing.assert_array_equal(np.delete(found, late, axis=0), np.delete(TRUE, late, axis=0))
