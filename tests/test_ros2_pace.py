"""Stamps that no sensor with the right clock would give, and measurements that no robots with one load would take."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from coheft.app.ros2.contents import Contents
from coheft.app.ros2.pace import Pace, words_of
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.tolerance import SensorTolerance
from coheft.wire.scenario.robot_sensors import RobotSensors

RATE = 100.0
START = 1_790_000_000_000_000_000
COUNT = 400
REGULAR = START + np.arange(COUNT) * 10**7
ARRIVAL = 5 * 10**12 + np.arange(COUNT) * 10**7
ALL_SENSORS = RobotSensors(SensorNoise(), SensorTolerance())
RNG = np.random.default_rng(1)


def pace(stamps: Array, arrivals: Array = ARRIVAL) -> Pace:
    made = Pace()
    for stamp, arrival in zip(stamps.tolist(), arrivals.tolist(), strict=True):
        made.note(int(stamp), arrival)
    return made


@pytest.mark.parametrize(
    ("stamps", "kind", "words"),
    [
        (np.full(COUNT, START), "still", "stamps stand still"),
        (REGULAR // 10**6, "unit", "stamps advance by 3.99e-06 s while 3.99 s pass: in another unit?"),
        (START + (REGULAR - START) * 1000, "unit", "stamps advance by 3.99e+03 s while 3.99 s pass"),
        (REGULAR // 10**9 * 10**9, "equal", "many stamps are equal to the one before: do they have nanoseconds?"),
        (REGULAR // 10**9 * 10**9 + REGULAR % 10**9 // 1000, "bunched", "1e-05 s apart with gaps of 1 s"),
        (START + 2 * (REGULAR - START), "slow", "50 a second by their stamps, expected sensors.rate, 100"),
        (START + (REGULAR - START) * 20 // 19, "slow", "95 a second by their stamps"),
        (START + (REGULAR - START) // 2, "fast", "200 a second by their stamps, of which 100 (sensors.rate) are used"),
        (REGULAR + RNG.normal(scale=4e6, size=COUNT), "scattered", "off regular times by 3.64 ms"),
        (REGULAR + 10**7 * (np.arange(COUNT) // 10), "lost", "% are missing by their stamps: lost on the way?"),
    ],
)
def test_stamps_that_no_right_clock_gives_are_named(stamps: Array, kind: str, words: str) -> None:
    fault = pace(stamps).fault(RATE)
    assert fault is not None
    assert fault.kind == kind
    assert words in fault.words


@pytest.mark.parametrize(
    ("stamps", "arrivals"),
    [
        (REGULAR, ARRIVAL),
        (REGULAR + RNG.normal(scale=5e5, size=COUNT), ARRIVAL + RNG.integers(0, 10**7, COUNT)),
        (REGULAR, ARRIVAL[0] + (ARRIVAL - ARRIVAL[0]) // 30),  # a recording that is played fast
        (REGULAR, ARRIVAL[0] + (ARRIVAL - ARRIVAL[0]) * 10),  # a slow simulation
        (REGULAR, ARRIVAL + 10**12 * (np.arange(COUNT) > 200)),  # one that pauses
        (REGULAR[:20] // 10**6, ARRIVAL[:20]),  # too few to tell
    ],
)
def test_nothing_is_wrong_with_clocks_of_any_speed(stamps: Array, arrivals: Array) -> None:
    assert pace(stamps, arrivals).fault(RATE) is None


def test_streams_with_the_same_fault_share_a_line_and_clocks_are_compared() -> None:
    slow, late = START + 2 * (REGULAR - START), REGULAR - 3 * 10**8
    paces = {
        "r1": {"wrench": pace(REGULAR), "twist": pace(REGULAR + 5 * 10**7), "acceleration": pace(REGULAR)},
        "r2": {"wrench": pace(late), "twist": pace(late), "acceleration": pace(late)},
        "r3": {"wrench": pace(slow), "twist": pace(slow), "acceleration": pace(slow)},
        "r4": {"wrench": pace(REGULAR), "twist": pace(REGULAR), "acceleration": pace(REGULAR)},
    }
    lines = list(words_of(paces, dict.fromkeys(paces, RATE)).values())
    assert lines[0].startswith("stamps of /r1/twist are 50 ms ahead of those of /r1/")
    assert lines[1].startswith("/r3/wrench, /r3/twist, /r3/acceleration: 50 a second")
    assert lines[2].startswith("stamps of r2 are 300 ms behind those of r")
    assert len(lines) == 3


def test_unknown_paces_are_not_compared() -> None:
    assert words_of({"r1": {"wrench": Pace()}, "r2": {"wrench": pace(REGULAR)}}, {"r1": RATE, "r2": RATE}) == {}


def swinging(change: Callable[[Array], Array] = np.copy) -> Array:
    """Samples (200, 15) of a robot that carries 3 kg and swings."""
    time = np.arange(200) / RATE
    samples = np.zeros((200, 15))
    samples[:, :3] = 0.5 * np.sin(np.outer(time, [5.0, 6.0, 7.0]))
    samples[:, 3:6] = 0.1 * np.cos(np.outer(time, [5.0, 6.0, 7.0]))
    samples[:, 8], samples[:, 11] = 9.81, 29.4
    samples[:, 9:] += 1e-3 * RNG.normal(size=(200, 6))
    return change(samples)


def scaled(columns: slice, factor: float) -> Callable[[Array], Array]:
    def change(samples: Array) -> Array:
        samples = samples.copy()
        samples[:, columns] *= factor
        return samples

    return change


@pytest.mark.parametrize(
    ("of_r1", "of_r2", "words"),
    [
        (np.copy, np.copy, ""),
        (
            np.copy,
            scaled(slice(6, 9), 1.0 / 9.81),
            "'acceleration' of r2 is 1 m/s² half of the time, expected about 9.81",
        ),
        (np.copy, scaled(slice(0, 3), 57.3), "'twist' of r2 turns at"),
        (scaled(slice(3, 6), 1000.0), np.copy, "'twist' of r1 moves at"),
        (
            scaled(slice(9, 15), -1.0),
            scaled(slice(9, 15), -1.0),
            "wrenches add up to -5.99 kg: they must be what the robots",
        ),
        (np.copy, scaled(slice(9, 12), 0.0), "forces of r2 are exactly the same for 2.0 s from 0.0 s on: its sensor"),
        (np.copy, scaled(slice(0, 6), 0.0), "angular velocities of r2 are exactly the same for 2.0 s from 0.0 s on"),
        (np.copy, scaled(slice(0, 3), 0.5), "angular velocities of r1, r2 are 33 % off the others' in size"),
    ],
)
def test_what_no_load_can_do_is_told(
    of_r1: Callable[[Array], Array], of_r2: Callable[[Array], Array], words: str
) -> None:
    contents = Contents({"r1": 10.0, "r2": 10.0}, {"r1": ALL_SENSORS, "r2": ALL_SENSORS})
    for robot, change in (("r1", of_r1), ("r2", of_r2)):
        for number, block in enumerate(np.split(swinging(change), 20)):
            contents.note(robot, number, block)
    assert contents.complaint(RATE).startswith(words)
    assert bool(contents.complaint(RATE)) == bool(words)


def test_a_sensor_that_a_robot_does_not_have_is_not_missed() -> None:
    def complaint(columns: slice, *missing: str) -> str:
        sensors = {"r1": ALL_SENSORS, "r2": ALL_SENSORS._replace(missing=missing)}
        contents = Contents({"r1": 10.0, "r2": 10.0}, sensors)
        for robot, change in (("r1", np.copy), ("r2", scaled(columns, 0.0))):
            for number, block in enumerate(np.split(swinging(change), 20)):
                contents.note(robot, number, block)
        return contents.complaint(RATE)

    assert complaint(slice(0, 6), "gyro", "velocity") == complaint(slice(0, 3), "gyro") == ""
    assert complaint(slice(12, 15), "torque") == ""
    assert complaint(slice(9, 12), "torque").startswith("forces of r2 are exactly the same")


def test_too_few_blocks_tell_nothing() -> None:
    contents = Contents({"r1": 10.0}, {"r1": ALL_SENSORS})
    contents.note("r1", 0, np.zeros((10, 15)))
    assert contents.complaint(RATE) == ""
