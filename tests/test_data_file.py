"""Recordings as files: what is written is read, and what cannot be read is said."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from coheft.errors import RecordingError
from coheft.estimation.batch.recording import Recording, RobotRecord, Truth
from coheft.estimation.geometry.spatial import Pose
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.wire.data.checks import COLUMNS
from coheft.wire.data.file import read_recording, write_recording

CHANNELS = tuple(COLUMNS)


def example(names: tuple[str, ...] = ("left", "right")) -> Recording:
    rng = np.random.default_rng(0)
    time = np.arange(30) / 100.0
    robots = {}
    for name in names:
        pose = rng.normal(size=(30, 7))
        pose[:, 3:] /= np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
        twist, dtwist, wrench = rng.normal(size=(3, 30, 6))
        robots[name] = RobotRecord(time, pose, twist, dtwist, rng.normal(size=(30, 3)), wrench)
    load = Inertia(2.0, np.ones(3), np.eye(3))
    return Recording(
        robots,
        gravity=np.array([0.0, 9.81, 0.0]),
        noise=SensorNoise(0.1, 0.2, 0.3, 0.4, 0.5),
        holds=((0.0, 0.1), (0.2, 0.25)),
        truth=Truth((Pose.identity(),) * len(names), ((0.0, load), (0.2, Inertia(3.0, np.ones(3), np.eye(3))))),
    )


def same_samples(one: Recording, other: Recording) -> None:
    assert one.names == other.names
    for name in one.names:
        for channel in ("time", *CHANNELS):
            np.testing.assert_array_equal(getattr(one.robots[name], channel), getattr(other.robots[name], channel))


def test_npz_keeps_everything(tmp_path: Path) -> None:
    written = example()
    write_recording(written, tmp_path / "x.npz")
    read = read_recording(tmp_path / "x.npz")
    same_samples(written, read)
    np.testing.assert_array_equal(read.gravity, written.gravity)
    assert (read.noise, read.holds) == (written.noise, written.holds)
    assert read.truth is not None
    first, whole = read.truth.load_between(0.0, 0.2), read.truth.load_between(0.0, 0.3)
    assert first is not None
    assert first.mass == 2.0
    assert whole is None
    after = read.truth.load_between(0.2, 0.3)
    assert after is not None
    assert after.mass == 3.0


def test_csv_keeps_samples_and_holds(tmp_path: Path) -> None:
    write_recording(example(), tmp_path / "folder")
    read = read_recording(tmp_path / "folder")
    same_samples(example(), read)
    assert read.holds == example().holds


def test_no_holds_are_not_the_same_as_holds_that_nobody_knows(tmp_path: Path) -> None:
    for path in (tmp_path / "x.npz", tmp_path / "folder"):
        for holds in ((), None):
            write_recording(replace(example(), holds=holds), path)
            assert read_recording(path).holds == holds


def test_files_name_the_moment_first(tmp_path: Path) -> None:
    write_recording(example(), tmp_path / "x.npz")
    wrench = example().robots["left"].wrench
    assert wrench is not None
    with np.load(tmp_path / "x.npz") as file:
        np.testing.assert_array_equal(file["left/wrench"][:, 3:], wrench[:, :3])
    write_recording(example(), tmp_path / "folder")
    header, first = (tmp_path / "folder" / "left.csv").read_text().splitlines()[:2]
    row = dict(zip(header.split(","), map(float, first.split(",")), strict=True))
    assert [row["fx"], row["mx"]] == [wrench[0, 0], wrench[0, 3]]


@pytest.mark.parametrize(
    "text",
    [
        "t,ax,ay,az\n\n0,1,2,3\n0.1,1,2,4\n\n",
        "t,ax,ay,az,\n0,1,2,3,\n0.1,1,2,4,\n",
        " t , ax, ay ,az\n 0 , 1,2, 3\n0.1,1,2,4 \n , , ,\n",
        "t,ax,ay,az\n0,1,2,3,\n0.1,1,2,4\n",
        "Time,AX,AY,AZ\n0,1,2,3\n0.1,1,2,4\n",
        "# taken on Monday\n# t,ax,ay,az\n0,1,2,3\n0.1,1,2,4\n# the end\n",
    ],
    ids=["blank lines", "commas at the end", "spaces", "some commas at the end", "capitals", "comments"],
)
@pytest.mark.parametrize("name", ["r1.csv", "r1.CSV"])
def test_csv_files_as_people_write_them(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    (tmp_path / "._r1.csv").write_bytes(b"\x00\x05\x16\x07")  # of another system's archives
    (tmp_path / "r2.csv").write_text(text)
    robot = read_recording(tmp_path).robots["r1"]
    np.testing.assert_array_equal(robot.time, [0.0, 0.1])
    np.testing.assert_array_equal(robot.acceleration, [[1.0, 2.0, 3.0], [1.0, 2.0, 4.0]])


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")])
@pytest.mark.parametrize("rate", [10.0, 100.0, 1000.0])
def test_times_may_be_in_other_units(
    tmp_path: Path, factor: float, unit: str, rate: float, caplog: pytest.LogCaptureFixture
) -> None:
    for name in ("r1", "r2"):
        lines = [f"{round(factor * (5.0 + k / rate))},1,2,3" for k in range(5)]
        (tmp_path / f"{name}.csv").write_text("\n".join(["t,ax,ay,az", *lines]))
    recording = read_recording(tmp_path)
    assert recording.rate == pytest.approx(rate)
    assert f"taken for {unit}, which makes {rate:g} samples per second" in caplog.text


def test_csv_files_may_begin_with_a_byte_order_mark(tmp_path: Path) -> None:
    write_recording(example(), tmp_path)
    for file in tmp_path.glob("*.csv"):
        file.write_text(file.read_text(), encoding="utf-8-sig")
    same_samples(example(), read_recording(tmp_path))


def test_a_folder_keeps_nothing_of_the_recording_before(tmp_path: Path) -> None:
    write_recording(example(("r1", "r2", "r3", "r4")), tmp_path)
    (tmp_path / "notes.txt").write_text("of mine")
    no_poses = {name: replace(robot, pose=None) for name, robot in example(("r1", "r2")).robots.items()}
    write_recording(Recording(no_poses), tmp_path)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["notes.txt", "r1.csv", "r2.csv"]
    read = read_recording(tmp_path)
    assert (read.names, read.holds, read.has("pose")) == (("r1", "r2"), None, False)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("r9.csv", "t,ax,ay,az\n0,1,2,3\n"),  # might be a recording of somebody's own: lines end in another way
        ("left.csv", "az,ay,ax,t\r\n0,1,2,3\r\n"),
        ("holds.csv", "start,end,why\r\n0,1,2\r\n"),
        ("results.csv", "mass\r\n2\r\n"),
        ("empty.csv", ""),
    ],
)
def test_files_of_others_in_the_folder_are_named_and_kept(tmp_path: Path, name: str, text: str) -> None:
    write_recording(example(("r1", "r2")), tmp_path)
    (tmp_path / name).write_text(text, newline="")
    before = {file: file.read_bytes() for file in tmp_path.iterdir()}
    with pytest.raises(RecordingError, match=f"of no recording which coheft wrote: {name};") as error:
        write_recording(example(), tmp_path)
    assert str(tmp_path) in str(error.value)
    assert {file: file.read_bytes() for file in tmp_path.iterdir()} == before


@pytest.mark.parametrize("name", ["holds", "../left", "a/b", ""])
def test_names_that_no_file_can_have_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(RecordingError, match=f"robot '{name}': no name of a file"):
        write_recording(example(("left", name)), tmp_path / "folder")
    assert list(tmp_path.iterdir()) == []


@contextmanager
def files_no_longer_than(size: int) -> Iterator[None]:
    """As if the disk were full."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@pytest.mark.parametrize("target", ["x.npz", "folder"])
def test_a_full_disk_leaves_the_recording_that_was_there(tmp_path: Path, target: str) -> None:
    path = tmp_path / target
    write_recording(example(), path)
    before = {file.name: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}
    with files_no_longer_than(5000), pytest.raises(RecordingError, match=r"cannot be written: File too large"):
        write_recording(example(("left", "other", "right")), path)
    assert {file.name: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()} == before
    same_samples(example(), read_recording(path))


def test_a_link_to_a_file_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "link.npz").symlink_to(tmp_path / "x.npz")
    write_recording(example(), tmp_path / "link.npz")
    assert (tmp_path / "link.npz").is_symlink()
    same_samples(example(), read_recording(tmp_path / "x.npz"))


def test_no_other_files_than_npz_are_written(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"x\.csv: expected a file that ends with \.npz, or a folder"):
        write_recording(example(), tmp_path / "x.csv")
    assert list(tmp_path.iterdir()) == []
