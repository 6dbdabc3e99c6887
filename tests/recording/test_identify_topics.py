"""Loads from MCAP files: of our own runs, and of other software."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore

from coheft.app.cli.base import EXIT_ERROR, EXIT_USAGE
from coheft.app.cli.main import run_command_line
from coheft.app.identify.methods import identify, read_any
from coheft.app.recording import ros
from coheft.app.recording.mcap_file import McapFile
from coheft.errors import RecordingError
from coheft.estimation.geometry.spatial import Array
from coheft.wire.data.file import write_recording
from tests import bar
from tests.recording.runs import news_of_a_run, record
from tests.synthetic_run import ROBOTS

Topic = tuple[str, Callable[..., ros.RosMessage], Array, Array]
START = 1_700_000_000 * 10**9


def pose_message(time: int, numbers: Array) -> ros.RosMessage:
    return ros.pose(time, "base", numbers[:3], numbers[[6, 3, 4, 5]])


def wrench_message(time: int, numbers: Array) -> ros.RosMessage:
    return ros.wrench(time, "tool0", numbers)


def write_topics(path: Path, topics: Sequence[Topic]) -> Path:
    """Write topics of other software: name, message, times (n,) [s], numbers (n, width); the network shuffles some."""
    with path.open("wb") as file:
        out = McapFile(file)
        for name, message, time, numbers in topics:
            for k in np.argsort(np.arange(len(time)) + 1.5 * (np.arange(len(time)) % 50 == 0), kind="stable"):
                out.write(name, START + round(1e9 * time[k]), message(START + round(1e9 * time[k]), numbers[k]))
        out.write("/notes", START, ros.number(1.0))
        out.finish()
    return path


def bar_topics(names: str) -> list[Topic]:
    topics = []
    for k, robot in enumerate(bar.ENDS):
        poses, wrenches = np.arange(0.0, 20.0, 0.01) + 0.013 * k, np.arange(0.0, 20.0, 0.008) + 0.005 * k
        topics.append((names.format(robot, "pose"), pose_message, poses, bar.poses(poses, robot)))
        topics.append((names.format(robot, "ft"), wrench_message, wrenches, bar.wrenches(wrenches)))
    return topics


@pytest.mark.parametrize(
    ("names", "chosen"),
    [
        ("/{0}/{1}", ()),
        ("/cell/{0}/arm/{1}", ()),
        ("/{1}_of_{0}", ("left=/ft_of_left,/pose_of_left", "right=/ft_of_right", "right=pose_of_right")),
    ],
)
def test_arms_are_found_in_files_of_other_software(
    tmp_path: Path, names: str, chosen: tuple[str, ...], caplog: pytest.LogCaptureFixture
) -> None:
    recording = read_any(write_topics(tmp_path / "x.mcap", bar_topics(names)), chosen)
    assert recording.names == ("left", "right")
    assert ("topics are taken, by their names, for those of left: /" in caplog.text) == (not chosen)
    assert recording.time[0] == 0.0
    found = identify(recording)
    assert found.doubts == ()
    assert found.payload.inertia.mass == pytest.approx(bar.MASS, rel=1e-4)
    np.testing.assert_allclose(found.payload.inertia.com, [0.5, 0.0, 0.0], atol=1e-4)


def restamped(change: Callable[[int], int]) -> list[Topic]:
    """The bar's topics with other stamps than times."""

    def made(message: Callable[..., ros.RosMessage]) -> Callable[..., ros.RosMessage]:
        return lambda time, numbers: message(change(time), numbers)

    return [(name, made(message), time, numbers) for name, message, time, numbers in bar_topics("/{0}/{1}")]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda time: time // 10**6, "/left/ft: stamps advance by .*e-06 s while .* s pass: in another unit?"),
        (lambda time: time // 10**9 * 10**9, "/left/ft: many stamps are equal to the one before"),
        (lambda time: time // 10**9 * 10**9 + time % 10**9 // 1000, "/left/ft: stamps are bunched"),
        (lambda _: START, "/left/ft: stamps stand still"),
    ],
)
def test_stamps_that_are_no_times_are_named(tmp_path: Path, change: Callable[[int], int], words: str) -> None:
    topics = sorted(restamped(change), key=lambda topic: topic[0])
    with pytest.raises(RecordingError, match=words.replace("/left/ft", "/(left|right)/(ft|pose)")):
        read_any(write_topics(tmp_path / "x.mcap", topics))


def test_robots_without_wrenches_are_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    time = np.arange(0.0, 20.0, 0.01)
    third = ("/third/pose", pose_message, time, bar.poses(time, "left"))
    recording = read_any(write_topics(tmp_path / "x.mcap", [*bar_topics("/{0}/{1}"), third]))
    assert recording.names == ("left", "right")
    assert "left out, for there is no wrench beside them: third: pose" in caplog.text


def test_a_bag_without_metadata_is_named_by_its_file(tmp_path: Path) -> None:
    folder = write_bag(tmp_path / "folder", bar_topics("/{0}/{1}"))
    (folder / "metadata.yaml").unlink()
    with pytest.raises(RecordingError, match=r"a bag without metadata.yaml: name its file instead, .*folder.db3"):
        read_any(folder)


def write_bag(path: Path, topics: Sequence[Topic]) -> Path:
    """The same as a bag of ROS 2, in a folder, or of ROS 1, by other software."""
    is_ros1 = path.suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_JAZZY)
    with Ros1Writer(path) if is_ros1 else Ros2Writer(path, version=9) as out:
        for name, message, time, numbers in topics:
            kind = message(0, numbers[0]).__msgtype__
            connection = out.add_connection(name, kind, typestore=store)
            for k, seconds in enumerate(time):
                stamp = START + round(1e9 * seconds)
                made = message(stamp, numbers[k])
                if is_ros1:
                    header = store.types["std_msgs/msg/Header"]
                    made.header = header(seq=k, stamp=made.header.stamp, frame_id="")
                out.write(connection, START + k, (store.serialize_ros1 if is_ros1 else store.serialize_cdr)(made, kind))
    return path


def odometry(time: int, numbers: Array) -> ros.RosMessage:
    types, pose = get_typestore(Stores.ROS2_JAZZY).types, pose_message(time, numbers)
    with_covariance = types["geometry_msgs/msg/PoseWithCovariance"](pose.pose, np.zeros(36))
    zero = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    still = types["geometry_msgs/msg/TwistWithCovariance"](types["geometry_msgs/msg/Twist"](zero, zero), np.zeros(36))
    made: ros.RosMessage = types["nav_msgs/msg/Odometry"](pose.header, "tool0", with_covariance, still)
    return made


@pytest.mark.parametrize("with_poses", [True, False])
def test_odometry_is_used_of_robots_without_other_poses(tmp_path: Path, with_poses: bool) -> None:
    topics = bar_topics("/{0}/{1}")
    others = [
        (f"{name}_of_wheels", odometry, times, numbers) for name, make, times, numbers in topics if "pose" in name
    ]
    kept = [topic for topic in topics if with_poses or "pose" not in topic[0]]
    if with_poses:  # wheels are elsewhere
        others = [(name, make, times, numbers + [9.0, 0, 0, 0, 0, 0, 0]) for name, make, times, numbers in others]
    found = identify(read_any(write_bag(tmp_path / "bag", [*others, *kept])))
    assert found.doubts == ()
    assert found.payload.inertia.mass == pytest.approx(bar.MASS, rel=1e-4)


def test_a_clock_that_was_set_back_is_told(tmp_path: Path) -> None:
    topics = bar_topics("/{0}/{1}")
    name, make, times, numbers = topics[1]
    topics[1] = (name, make, times - 3.0 * (times > 10.0), numbers)
    with pytest.raises(RecordingError, match=rf"{name}: the stamp of message 1\d\d\d is 2.99 s before that of the one"):
        read_any(write_bag(tmp_path / "bag", topics))


@pytest.mark.parametrize("name", ["folder", "x.bag"])
def test_bags_of_ros_are_read(tmp_path: Path, name: str) -> None:
    written = write_topics(tmp_path / "x.mcap", bar_topics("/{0}/{1}"))
    bag, mcap = read_any(write_bag(tmp_path / name, bar_topics("/{0}/{1}"))), read_any(written)
    assert bag.names == mcap.names
    for one, other in zip(bag.robots.values(), mcap.robots.values(), strict=True):
        for channel in ("time", "pose", "wrench"):
            np.testing.assert_array_equal(getattr(one, channel), getattr(other, channel))


HELD = (
    r"Topics that could be used: /ft_of_left \(geometry_msgs/WrenchStamped, 2500\), .*std_msgs/Float64, which cannot be"
)


@pytest.mark.parametrize(
    ("chosen", "message"),
    [
        (
            (),
            rf"found robots by the names of topics: ft_of_left: wrench; .* --topics ROBOT=TOPIC.*{HELD}",
        ),
        (("left=/ft",), f"--topics: there is no topic '/ft'. {HELD}"),
        (("/ft_of_left",), f"--topics: found '/ft_of_left', expected ROBOT=TOPIC. {HELD}"),
        (("a=/notes",), rf"--topics: /notes \(std_msgs/Float64, 1\) cannot be used; expected one of .*{HELD}"),
        (("a=/ft_of_left", "b=/ft_of_right,/pose_of_right"), rf"found a: wrench; b: wrench, pose; expected .*{HELD}"),
        (("a=/ft_of_left,/ft_of_right",), "/ft_of_left and /ft_of_right both tell the wrench of a, expected one"),
    ],
)
def test_topics_that_are_not_there_or_not_told_apart_are_listed(
    tmp_path: Path, chosen: tuple[str, ...], message: str
) -> None:
    path = write_topics(tmp_path / "x.mcap", bar_topics("/{1}_of_{0}"))
    with pytest.raises(RecordingError, match=message):
        read_any(path, chosen)


def test_our_own_files_tell_noise_and_truth(tmp_path: Path) -> None:
    recording = read_any(record(tmp_path / "run.mcap", news_of_a_run()))
    assert recording.names == tuple(ROBOTS)
    assert recording.noise is not None
    assert recording.truth is not None
    assert [load.mass for _, load in recording.truth.loads] == [10.0, 13.0]
    assert recording.has("twist")
    assert recording.has("acceleration")


def test_files_that_are_cut_are_refused(tmp_path: Path) -> None:
    path = record(tmp_path / "run.mcap", news_of_a_run(), finish=False)
    with pytest.raises(RecordingError, match=r"is not complete: .*coheft recover"):
        read_any(path)
    path.write_bytes(b"something else")
    with pytest.raises(RecordingError, match="not an MCAP file"):
        read_any(path)


@pytest.mark.parametrize("place", range(50, 4000, 379))
def test_damaged_files_are_refused_or_read(tmp_path: Path, place: int) -> None:
    good = record(tmp_path / "run.mcap", news_of_a_run()).read_bytes()
    (tmp_path / "bad.mcap").write_bytes(good[:place] + bytes([good[place] ^ 0x55]) + good[place + 1 :])
    try:
        read_any(tmp_path / "bad.mcap")
    except RecordingError as error:
        assert "bad.mcap" in str(error)  # noqa: PT017


def test_topics_are_of_files_that_have_some(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_topics(tmp_path / "x.mcap", bar_topics("/{0}/{1}"))
    write_recording(read_any(path), tmp_path / "x.npz")
    assert run_command_line(["identify", str(tmp_path / "x.npz"), "--topics", "a=/b", "c=/d"]) == EXIT_USAGE
    assert "--topics chooses among those of an MCAP file" in capsys.readouterr().err
    assert run_command_line(["identify", str(path), "--topics", "a=/b", "c=/d"]) == EXIT_ERROR
    assert "there is no topic '/b'" in capsys.readouterr().err


def test_without_the_package_that_reads_topics_it_is_named(tmp_path: Path) -> None:
    path = write_topics(tmp_path / "x.mcap", bar_topics("/{0}/{1}"))
    program = (
        "import sys; sys.modules['rosbags'] = None\n"
        "from coheft.app.cli.main import run_command_line\n"
        f"sys.exit(run_command_line(['identify', {str(path)!r}]))"
    )
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert run.returncode == EXIT_ERROR
    assert "this needs the package 'rosbags': install 'coheft[record]'" in run.stderr
