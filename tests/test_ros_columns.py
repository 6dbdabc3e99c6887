"""CSV files that ``rostopic echo -p`` has written: a file per topic, each at times of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from coheft.app.identify.methods import identify
from coheft.errors import RecordingError
from coheft.estimation.geometry.spatial import Array
from coheft.wire.data.file import read_recording
from tests import bar

NAMES = {
    "pose": [*(f"pose.position.{a}" for a in "xyz"), *(f"pose.orientation.{a}" for a in "xyzw")],
    "wrench": [*(f"wrench.force.{a}" for a in "xyz"), *(f"wrench.torque.{a}" for a in "xyz")],
}
START = 1_700_000_000.0
"""When the recording begins [s of ROS time]."""


def echo(path: Path, channel: str, time: Array, values: Array, *, stamped: bool = True) -> None:
    """Write a topic as ``rostopic echo -p`` does: text among the numbers, received some milliseconds later."""
    header = ["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id"]
    lines = [",".join(header + [f"field.{name}" for name in NAMES[channel]])]
    for k, (seconds, row) in enumerate(zip(time, values.tolist(), strict=True)):
        stamp = round((START + seconds) * 1e9)
        lines.append(",".join([str(stamp + 3_000_000), str(k), str(stamp if stamped else 0), "tool0", *map(repr, row)]))
    path.write_text("\n".join(lines))


def echo_bar(folder: Path, *, stamped: bool = True) -> None:
    """All four topics: sensors that begin at different times, at different rates, not quite regularly."""
    rng = np.random.default_rng(0)
    for k, name in enumerate(bar.ENDS):
        poses = 0.3 * k + np.arange(0.0, 16.0, 0.01)
        wrenches = 0.1 * k + np.arange(0.0, 16.0, 0.002) + rng.uniform(-4e-4, 4e-4, 8000)
        echo(folder / f"{name}_pose.csv", "pose", poses, bar.poses(poses, name), stamped=stamped)
        echo(folder / f"{name}_wrench.csv", "wrench", wrenches, bar.wrenches(wrenches), stamped=stamped)


def test_topics_are_brought_to_the_same_times(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    echo_bar(tmp_path)
    (tmp_path / "holds.csv").write_text(f"start,end\n{round(1e9 * START)},{round(1e9 * (START + 9.0))}\n")
    recording = read_recording(tmp_path)
    assert recording.names == ("left", "right")
    assert recording.rate == pytest.approx(100.0, rel=1e-6)
    assert recording.time[0] == 0.0
    assert recording.holds is not None
    assert recording.holds[0] == pytest.approx((-0.3, 8.7), abs=1e-5)
    assert "topics as 'rostopic echo -p' writes them, by their names of left: pose, wrench; right: pose" in caplog.text
    for told in ("100 samples per second, the rate of 'pose' of", "of ROS", "taken for nanoseconds"):
        assert told in caplog.text
    robot = recording.robots["right"]
    assert robot.pose is not None
    assert robot.wrench is not None
    np.testing.assert_allclose(robot.pose, bar.poses(recording.time + 0.3, "right"), atol=1e-6)
    np.testing.assert_allclose(robot.wrench[500:-500], bar.wrenches(recording.time + 0.3)[500:-500], atol=1e-3)
    found = identify(recording)
    assert found.doubts == ()
    assert found.payload.inertia.mass == pytest.approx(bar.MASS, rel=1e-4)
    np.testing.assert_allclose(found.payload.inertia.com, [0.5, 0.0, 0.0], atol=1e-4)


@pytest.mark.parametrize(("seconds", "rest"), [("secs", "nsecs"), ("sec", "nanosec")])
def test_stamps_may_be_in_two_columns(tmp_path: Path, seconds: str, rest: str) -> None:
    """As programs for bags write them, with names of topics in those of files."""
    time = np.arange(0.0, 16.0, 0.01)
    for name in bar.ENDS:
        for channel, topic, values in (
            ("pose", "tool-pose", bar.poses(time, name)),
            ("wrench", "ft_sensor-wrench", bar.wrenches(time)),
        ):
            header = ["Time", f"header.stamp.{seconds}", f"header.stamp.{rest}", "header.frame_id", *NAMES[channel]]
            lines = [",".join(header)]
            for at, row in zip(time, values.tolist(), strict=True):
                whole = int(START + at + 1e-6)
                nanoseconds = round((START + at - whole) * 1e9)
                lines.append(",".join([f"{START + at + 0.02}", str(whole), str(nanoseconds), "tool0", *map(repr, row)]))
            (tmp_path / f"{name}-{topic}.csv").write_text("\n".join(lines))
    recording = read_recording(tmp_path)
    assert set(recording.names) == set(bar.ENDS)
    assert recording.rate == pytest.approx(100.0, rel=1e-3)
    np.testing.assert_allclose(recording.stacked("pose")[0, 100], bar.poses(time, recording.names[0])[100], atol=1e-4)


def test_without_stamps_the_times_of_receiving_are_taken_and_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    echo_bar(tmp_path, stamped=False)
    read_recording(tmp_path)
    assert "left_pose.csv: all stamps are zero: taken from %time" in caplog.text


def test_what_lies_beyond_a_gap_is_left_out_and_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    echo_bar(tmp_path)
    time = np.arange(0.0, 16.0, 0.01)
    time = time[(time < 10.0) | (time > 10.8)]
    echo(tmp_path / "left_pose.csv", "pose", time, bar.poses(time, "left"))
    assert read_recording(tmp_path).time[-1] == pytest.approx(9.69, abs=0.011)  # counts from the start of the last one
    assert "'pose' of left has no samples from 9.690 s to 10.510 s" in caplog.text


@pytest.mark.parametrize(
    ("header", "row", "message"),
    [
        (
            "%time,field.header.stamp,field.wrench.force.x,field.wrench.force.y",
            "1,1,2,3",
            r"'wrench' lacks columns field.force.z, field.torque.x, .*; found %time, field.header.stamp, field.wrench",
        ),
        (
            "%time,field.data",
            "1,1",
            r"found columns %time, field.data: none of what a robot measures; expected pose: field.….position.x",
        ),
        (
            "%time," + ",".join(f"field.{name}" for name in NAMES["wrench"]),
            "1,2,3,4,x,6,7\n2,2,3,4,5,6,7",
            r"line 2, column 'field.wrench.torque.x': found 'x'; expected a number",
        ),
        (
            "%time," + ",".join(f"field.{name}" for name in NAMES["wrench"]),
            "5,2,3,4,5,6,7\n2,2,3,4,5,6,7",
            r"line 3 is of 2 ns, the one before of 5 ns",
        ),
        (
            ",".join(f"field.{name}" for name in NAMES["wrench"]),
            "2,3,4,5,6,7\n2,3,4,5,6,7",
            r"found no column %time or field.header.stamp: expected one with times in nanoseconds",
        ),
    ],
)
def test_tables_that_cannot_be_used_are_refused(tmp_path: Path, header: str, row: str, message: str) -> None:
    (tmp_path / "left_wrench.csv").write_text(f"{header}\n{row}\n")
    with pytest.raises(RecordingError, match=f"left_wrench.csv: {message}"):
        read_recording(tmp_path)


def test_a_robot_for_each_file_is_refused_with_the_names_that_are_expected(tmp_path: Path) -> None:
    time = np.arange(10) / 100.0
    echo(tmp_path / "a.csv", "pose", time, bar.poses(time, "left"))
    echo(tmp_path / "b.csv", "wrench", time, bar.wrenches(time))
    with pytest.raises(RecordingError, match=r"a: pose; b: wrench\); expected files of one robot to be named alike"):
        read_recording(tmp_path)


def test_two_files_of_one_channel_are_refused(tmp_path: Path) -> None:
    time = np.arange(10) / 100.0
    for name in ("a_wrench.csv", "wrench_a.csv"):
        echo(tmp_path / name, "wrench", time, bar.wrenches(time))
    with pytest.raises(RecordingError, match=r"wrench_a.csv: a second 'wrench' of a, expected one"):
        read_recording(tmp_path)
