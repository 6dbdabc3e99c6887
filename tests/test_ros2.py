"""Measurements that come over ROS 2 and are put together by their stamps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coheft.app.recording import ros
from coheft.app.ros2.drive import drive
from coheft.app.ros2.samples import AT_ONCE, STREAMS, BlockBuilder, Readings, read
from coheft.app.ros2.stamps import Stamps
from coheft.app.run.plan import make_plan
from coheft.errors import LinkError, MessageError, UsageError
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.tolerance import SENSORS, SensorTolerance
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.robot_sensors import RobotSensors

RATE, BLOCK = 500, 4
EPOCH = 1_790_000_000_000_000_000
PERIOD = 10**9 // RATE


def test_a_part_of_a_team_has_to_be_told_when_the_run_begins() -> None:
    agents = make_plan(load_scenario("ring6")).agents
    with pytest.raises(UsageError, match=r"^no --epoch, and r3, r6 not driven here: .* the same --epoch"):
        drive([agents["r1"], agents["r2"]], "tcp/127.0.0.1:1", 0, None, pytest.fail)


@pytest.mark.parametrize(("driven", "epoch"), [(["r1", "r2"], 5.0), (["r1", "r2", "r3"], None)])
def test_whoever_is_told_or_drives_the_whole_team_may_begin(driven: list[str], epoch: float | None) -> None:
    agents = make_plan(load_scenario("ring3")).agents
    with pytest.raises(LinkError, match="no router of ROS 2"):
        drive([agents[name] for name in driven], "tcp/127.0.0.1:1", 0, epoch, pytest.fail)


def message(stream: str, time: int, sample: np.ndarray) -> bytes:
    columns = sample[STREAMS[stream].columns]
    made = {"wrench": ros.wrench, "twist": ros.twist, "acceleration": ros.acceleration}[stream](time, "r1", columns)
    return bytes(ros.to_cdr(made))


def started(*missing: str) -> BlockBuilder:
    """Of a robot whose stamp was ``EPOCH`` when our own clock was 0."""
    stamps = Stamps(1)
    stamps.receive("r1", EPOCH, 0)
    assert stamps.settle(patient=True) == EPOCH
    return BlockBuilder("r1", RATE, BLOCK, EPOCH, stamps, RobotSensors(SensorNoise(), SensorTolerance(), missing))


def add(
    builder: BlockBuilder,
    number: int,
    sample: np.ndarray,
    late: int = 0,
    streams: tuple[str, ...] = (),
    speed: float = 1.0,
) -> list:
    """Sample ``number``, stamped so much late [ns], from a recording at some speed; the blocks that it completes."""
    found = []
    for stream in streams or STREAMS:
        data = message(stream, EPOCH + number * PERIOD + late, sample)
        block = builder.add(stream, *read(stream, data), round(number * PERIOD / speed))
        if block is not None:
            found.append(block)
    return found


@given(st.lists(st.integers(-PERIOD // 2 + 1, PERIOD // 2 - 1), min_size=3 * BLOCK, max_size=3 * BLOCK))
def test_measurements_come_to_lie_where_their_stamps_say(lateness: list[int]) -> None:
    samples = np.random.default_rng(1).normal(size=(len(lateness), 15))
    builder = started()
    found = [b for number, late in enumerate(lateness) for b in add(builder, number, samples[number], late)]
    assert [number for number, _ in found] == [0, 1, 2]
    np.testing.assert_array_equal(np.concatenate([block for _, block in found]), samples)


def test_streams_need_not_keep_step() -> None:
    samples = np.random.default_rng(1).normal(size=(2 * BLOCK, 15))
    builder = started()
    for stream in ("twist", "acceleration"):
        for number, sample in enumerate(samples):
            assert not add(builder, number, sample, streams=(stream,))
    found = [b for number, sample in enumerate(samples) for b in add(builder, number, sample, streams=("wrench",))]
    np.testing.assert_array_equal([block for _, block in found], samples.reshape(2, BLOCK, 15))


@pytest.mark.parametrize(
    ("missing", "streams"),
    [
        (("gyro",), ("wrench", "twist", "acceleration")),
        (("acceleration",), ("wrench", "twist")),
        (("gyro", "velocity"), ("wrench", "acceleration")),
        (("force", "torque"), ("twist", "acceleration")),
    ],
)
def test_no_topic_is_needed_for_what_a_robot_does_not_measure(
    missing: tuple[str, ...], streams: tuple[str, ...]
) -> None:
    builder, sample = started(*missing), np.arange(1.0, 16.0)
    assert tuple(builder.counts) == streams
    found = [block for number in range(BLOCK) for block in add(builder, number, sample, streams=streams)]
    ((_, samples),) = found
    assert np.isfinite(samples).all()
    if streams != tuple(STREAMS):
        assert (samples == 0.0).any(axis=0).tolist() == np.repeat([s in missing for s in SENSORS], 3).tolist()


def test_a_block_that_misses_a_measurement_is_given_up_and_the_next_is_not() -> None:
    sample = np.ones(15)
    builder = started()
    found = [b for number in range(3 * BLOCK) if number != 5 for b in add(builder, number, sample)]
    assert [number for number, _ in found] == [0, 2]
    assert not add(builder, 5, sample)  # too late


def test_what_was_measured_before_the_epoch_is_left_out() -> None:
    builder = started()
    assert [b for number in range(-BLOCK, 0) for b in add(builder, number, np.ones(15))] == []
    assert len([b for number in range(BLOCK) for b in add(builder, number, np.ones(15))]) == 1


def test_wrong_stamps_do_no_lasting_harm() -> None:
    builder = started()
    for glitch in range(50):
        add(builder, 0, np.ones(15), late=10**9 + glitch * 10**8)
    found = [b for number in range(4 * BLOCK) for b in add(builder, number, np.ones(15))]
    assert [number for number, _ in found] == [0, 1, 2, 3]


def test_a_whole_block_with_wrong_stamps_is_refused_in_words_and_does_no_lasting_harm() -> None:
    builder, found = started(), []
    for number in range(4 * BLOCK):
        if BLOCK <= number < 2 * BLOCK:
            with pytest.raises(MessageError, match=r"3600\.0 s ahead of the time that has passed.* check the robot's"):
                add(builder, number, np.ones(15), late=3600 * 10**9)
        else:
            found += add(builder, number, np.ones(15))
    assert [number for number, _ in found] == [0, 2, 3]


@pytest.mark.parametrize("speed", [0.1, 1.0, 50.0])
def test_recordings_may_be_played_at_any_speed(speed: float) -> None:
    builder = started()
    blocks = 30 * RATE // BLOCK
    count = sum(len(add(builder, number, np.ones(15), speed=speed)) for number in range(blocks * BLOCK))
    assert count == blocks


@pytest.mark.parametrize("pause", [60, 10**5])
def test_sensors_and_simulations_may_pause(pause: int) -> None:
    sample = np.ones(15)
    builder = started()
    assert len([b for number in range(BLOCK) for b in add(builder, number, sample)]) == 1
    later = range(pause * RATE, pause * RATE + BLOCK)
    assert len([b for number in later for b in add(builder, number, sample)]) == 1
    builder = started()
    assert len([b for number in range(BLOCK) for b in add(builder, number, sample)]) == 1
    found = []
    for number in range(BLOCK, 2 * BLOCK):
        for stream in STREAMS:
            found.append(
                builder.add(stream, *read(stream, message(stream, EPOCH + number * PERIOD, sample)), pause * 10**9)
            )
    assert len([block for block in found if block is not None]) == 1


def test_it_is_known_how_far_behind_stamps_are() -> None:
    builder = started()
    for number in range(BLOCK):
        add(builder, number, np.ones(15))
    assert builder.behind == 0.0
    assert not add(builder, BLOCK, np.ones(15), late=-3600 * 10**9)
    assert builder.behind == pytest.approx(3600.0)


def leads(**seconds: float) -> Stamps:
    """What is known of three robots when each one's clock was so far ahead of ours [s]."""
    stamps = Stamps(3)
    for name, lead in seconds.items():
        stamps.receive(name, round(lead * 1e9), 0)
    return stamps


@pytest.mark.parametrize("wrong", [3600.0, -3600.0, -1.79e9])
def test_one_wrong_clock_does_not_decide_when_the_run_begins(wrong: float) -> None:
    stamps = leads(r1=wrong)
    assert stamps.settle(patient=True) is None
    stamps.receive("r2", 10**9, 0)
    assert stamps.settle(patient=True) is None
    assert stamps.settle(patient=False) is None
    assert ("r1" if wrong > 0 else "r2") in stamps.disagreement
    stamps.receive("r3", 2 * 10**9, 0)
    assert stamps.settle(patient=True) == 2 * 10**9
    stamps.check("r1", 7 * 10**9, 0)
    with pytest.raises(MessageError, match="ahead"):
        stamps.check("r1", 3600 * 10**9, 0)


def test_most_robots_may_jump_but_not_one() -> None:
    stamps = leads(r1=0.0, r2=0.0, r3=0.0)
    assert stamps.settle(patient=True) == 0
    with pytest.raises(MessageError, match="ahead"):
        stamps.check("r1", 3600 * 10**9, 0)
    stamps.check("r3", 10**9, 0)
    with pytest.raises(MessageError, match="ahead"):
        stamps.check("r2", 1800 * 10**9, 0)  # another time
    stamps.check("r2", 3601 * 10**9, 0)
    stamps.check("r1", 3602 * 10**9, 0)
    stamps.check("r3", 10**9, 0)


def test_robots_that_do_not_measure_are_not_waited_for_for_ever() -> None:
    stamps = leads(r1=1.0)
    assert stamps.settle(patient=True) is None
    assert stamps.settle(patient=False) == 10**9
    assert leads().settle(patient=False) is None
    assert leads().disagreement == leads(r1=1.0, r2=9.0).disagreement == ""


@pytest.mark.parametrize("stream", STREAMS)
def test_numbers_that_are_not_finite_are_refused(stream: str) -> None:
    with pytest.raises(MessageError, match="not finite"):
        read(stream, message(stream, EPOCH, np.full(15, np.inf)))


@pytest.mark.parametrize("stream", STREAMS)
def test_messages_that_are_cut_short_are_refused(stream: str) -> None:
    data = message(stream, EPOCH, np.ones(15))
    read(stream, data)
    for length in range(len(data)):
        with pytest.raises(MessageError, match="not a geometry_msgs"):
            read(stream, data[:length])


def test_no_measurement_is_lost_between_two_readings() -> None:
    readings = Readings(pytest.fail)
    for number in range(3 * AT_ONCE):
        readings.put("r1", "twist", message("twist", EPOCH + number, np.ones(15)))
    parts = [[reading.stamp - EPOCH for reading in readings.take(0.0)] for _ in range(4)]
    assert [len(part) for part in parts] == [AT_ONCE, AT_ONCE, AT_ONCE, 0]
    assert [stamp for part in parts for stamp in part] == list(range(3 * AT_ONCE))


def test_what_makes_no_sense_is_told_and_does_not_hide_what_follows() -> None:
    complaints: list[str] = []
    readings = Readings(complaints.append)
    readings.put("r1", "twist", b"rubbish")
    readings.put("r1", "twist", message("twist", EPOCH, np.ones(15)))
    assert [reading.stamp for reading in readings.take(0.0)] == [EPOCH]
    assert len(complaints) == 1
    assert complaints[0].startswith("refused from /r1/twist: not a geometry_msgs")


@given(st.sampled_from(list(STREAMS)), st.binary(max_size=8), st.integers(0, 100), st.integers(0, 120))
def test_bytes_that_are_no_message_are_refused(stream: str, damage: bytes, at: int, length: int) -> None:
    data = bytearray(message(stream, EPOCH, np.ones(15)))
    data[at : at + len(damage)] = damage
    try:
        _, values = read(stream, bytes(data[:length]))
    except MessageError:
        return
    assert np.isfinite(values).all()


@pytest.mark.parametrize("stream", STREAMS)
def test_stamps_of_zero_are_refused(stream: str) -> None:
    with pytest.raises(MessageError, match=r"its stamp is zero: expected the time of the measurement in header\.stamp"):
        read(stream, message(stream, 0, np.ones(15)))
