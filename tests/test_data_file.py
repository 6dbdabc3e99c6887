"""Recordings as files: what is written is read, and what cannot be read is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from coheft.errors import RecordingError
from coheft.estimation.batch.recording import Recording, RobotRecord, Truth
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.rigid_body import Inertia
from coheft.estimation.spatial import Pose
from coheft.wire.data_file import COLUMNS, read_recording, write_recording

CHANNELS = tuple(COLUMNS)


def example() -> Recording:
    rng = np.random.default_rng(0)
    time = np.arange(30) / 100.0
    robots = {}
    for name in ("left", "right"):
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
        truth=Truth((Pose.identity(), Pose.identity()), ((0.0, load), (0.2, Inertia(3.0, np.ones(3), np.eye(3))))),
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


def npz(**changes: object) -> dict[str, object]:
    arrays: dict[str, object] = {}
    for name in ("r1", "r2"):
        arrays[f"{name}/t"] = np.arange(10) / 10.0
        arrays[f"{name}/twist"] = np.zeros((10, 6))
    arrays.update({key.replace("__", "/"): value for key, value in changes.items()})
    return {key: value for key, value in arrays.items() if value is not None}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"r2__speed": np.zeros(10)}, "'speed' of r2 is unknown; allowed: t, pose, twist"),
        ({"r2__t": None}, "'t' of r2 is missing"),
        ({"r2__twist": np.zeros((10, 5))}, r"'twist' of r2: found shape \(10, 5\), expected \(10, 6\)"),
        ({"r2__wrench": np.zeros((9, 6))}, r"'wrench' of r2: found shape \(9, 6\), expected \(10, 6\)"),
        ({"colour": np.zeros(3)}, "key 'colour' is unknown"),
        ({"gravity": np.zeros(2)}, "'gravity': found shape"),
        ({"noise": np.zeros(5)}, "'noise': expected 5 positive numbers"),
        ({"holds": np.zeros(3)}, "'holds': found shape"),
        ({"truth__poses": np.zeros((2, 12))}, "'truth': incomplete: 't'"),
        ({"r2__t": np.array(["a"] * 10)}, "not an .npz file of numbers"),
    ],
)
def test_npz_files_that_cannot_be_used_are_refused(tmp_path: Path, changes: dict[str, object], message: str) -> None:
    path = tmp_path / "x.npz"
    np.savez(path, **npz(**changes))  # type: ignore[arg-type]
    with pytest.raises(RecordingError, match=message) as error:
        read_recording(path)
    assert str(path) in str(error.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,wx,wy\n0,1,2\n", "'twist' lacks columns wz, vx, vy, vz"),
        ("t,speed\n0,1\n", "column 'speed' is unknown"),
        ("t,ax,ay,az\n0,1,2\n", "line 2: found 3 values, expected 4"),
        ("t,ax,ay,az\n0,1,2,three\n", "could not convert string to float"),
        ("t,ax,ay,az\n", "expected a line with the names of columns, then numbers"),
        ("ax,ay,az\n1,2,3\n", "'t' of r1 is missing"),
    ],
)
def test_csv_files_that_cannot_be_used_are_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "r1.csv").write_text(text)
    with pytest.raises(RecordingError, match=message):
        read_recording(tmp_path)


def test_what_is_not_there_or_no_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot be read"):
        read_recording(tmp_path / "nothing.npz")
    with pytest.raises(RecordingError, match=r"no \.csv files"):
        read_recording(tmp_path)
    (tmp_path / "text.npz").write_text("hello")
    with pytest.raises(RecordingError, match="not an"):
        read_recording(tmp_path / "text.npz")
    with pytest.raises(RecordingError, match="cannot be written"):
        write_recording(example(), tmp_path / "no" / "such" / "x.npz")
