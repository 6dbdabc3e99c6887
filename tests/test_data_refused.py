"""Files that cannot be read as recordings are refused, and it is said why."""

from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from coheft.app.identify.methods import identify
from coheft.errors import RecordingError
from coheft.estimation.batch.recording import Recording, RobotRecord, check_recording
from coheft.wire.data.checks import gravity_of
from coheft.wire.data.file import read_recording, write_recording
from tests.estimation.batch_team import held_recording
from tests.test_data_file import example, same_samples


def npz(**changes: object) -> dict[str, object]:
    arrays: dict[str, object] = {}
    for name in ("r1", "r2"):
        arrays[f"{name}/t"] = np.arange(10) / 10.0
        arrays[f"{name}/twist"] = np.zeros((10, 6))
    arrays.update({key.replace("__", "/"): value for key, value in changes.items()})
    return {key: value for key, value in arrays.items() if value is not None}


def truth(**changes: object) -> dict[str, object]:
    arrays = {"poses": np.zeros((2, 12)), "t": [0.0], "mass": [2.0], "com": np.zeros((1, 3)), "inertia": [np.eye(3)]}
    return {f"truth__{key}": value for key, value in {**arrays, **changes}.items()}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"r2__speed": np.zeros(10)}, "'speed' of r2 is unknown; allowed: t, pose, twist"),
        ({"r2__t": None}, "'t' of r2 is missing"),
        ({"r2__twist": np.zeros((10, 5))}, r"'twist' of r2: found shape \(10, 5\), expected \(10, 6\)"),
        (
            {"r2__twist": np.vstack([np.zeros((8, 6)), np.full((2, 6), np.nan)])},
            r"'twist' of r2: not a finite number at 0.8 s \(in all, in 2 samples\); .*: leave these samples out",
        ),
        ({"r2__wrench": np.zeros((9, 6))}, r"'wrench' of r2: found shape \(9, 6\), expected \(10, 6\)"),
        ({"colour": np.zeros(3)}, "key 'colour' is unknown"),
        ({"gravity": np.zeros(2)}, "'gravity': found shape"),
        ({"noise": np.zeros(5)}, "'noise': expected 5 positive numbers"),
        ({"holds": np.zeros(3)}, "'holds': found shape"),
        ({"gravity": np.array([0.0, 0.0, np.nan])}, "'gravity': found nan, expected finite numbers"),
        (
            {"noise": np.array([1.0, 1.0, np.inf, 1.0, 1.0])},
            r"'noise': expected 5 positive .*found \[1.0, 1.0, inf",
        ),
        ({"noise": np.array([1.0, 1.0, np.nan, 1.0, 1.0])}, "'noise': expected 5 positive numbers"),
        ({"holds": [[0.0, 0.5], [5.0, 1.0]]}, "'holds': found one from 5 to 1, expected its start before its end"),
        ({"holds": [[0.0, np.nan]]}, "'holds': found nan"),
        ({"r2__t": 0.0}, r"'t' of r2: found shape \(\), expected \(1,\)"),
        ({"r2__t": np.append(np.arange(9) / 10.0, np.inf)}, "'t' of r2: found inf"),
        ({"truth__poses": np.zeros((2, 12))}, "'truth': incomplete: 't'"),
        (truth(poses=np.zeros((1, 12))), r"'truth/poses': found shape \(1, 12\), expected \(2, 12\)"),
        (truth(mass=2.0), r"'truth/mass': found shape \(\), expected \(1,\)"),
        (truth(t=0.0), r"'truth/t': found shape \(\), expected \(1,\)"),
        (truth(com=[[0.0, np.inf, 0.0]]), "'truth/com': found inf"),
        (truth(colour=[1.0]), "'truth/colour' is unknown; allowed: poses, t, mass, com, inertia"),
        (truth(t=[1.0, 0.0], mass=[1.0, 2.0], com=np.zeros((2, 3)), inertia=np.zeros((2, 3, 3))), "expected growing"),
        ({f"{name}__{key}": None for name in ("r1", "r2") for key in ("t", "twist")}, "no robots in it"),
        ({"r2__twist": np.zeros((10, 6), dtype=complex)}, "'r2/twist' holds values of type complex128"),
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
        ("t,ax,ay,az\n0,1,2\n", "line 2: found 3 values, expected 4: one for each name in the first line"),
        ("t,ax,ay,az\n0,1,2,3\n0.1,1,nan,3\n", "line 3, column 'ay': found 'nan' .in all, 1 values are not finite"),
        ("t,ax,ay,az\n0,1,2,3\n\n0.1,1,2,3\n0.1,1,2,3\n", "line 5 is of 0.1, the one before of 0.1 .in all, 1 "),
        ("t,ax,ay,az,T\n0,1,2,3,20\n", "columns t, T all are t"),
        ("t,ax,ay,az\n0,1,2,three\n", "line 2, column 'az': found 'three'; expected a number such as 1.5"),
        ("t,ax,ay,az\n", "expected a line with the names of columns, then numbers"),
        ("ax,ay,az\n1,2,3\n", "'t' of r1 is missing"),
        ("t,ax,ay,az\n45000,1,2,3\n45000.0000001,1,2,4\n", "1e.07 samples per second: expected seconds .* days, as"),
        ("1700000000,0,tool0,1.5,2.5,3.5\n", "the first line holds numbers, expected the names of the columns"),
    ],
)
def test_csv_files_that_cannot_be_used_are_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "r1.csv").write_text(text)
    with pytest.raises(RecordingError, match=message):
        read_recording(tmp_path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"t,wx,ax,ay,az,wx\n0,1,2,3,4,5\n", "r1.csv: column 'wx' is there 2 times, expected once"),
        ("t,ax,ay,az\n0,1,2,3\n".encode("utf-16"), "r1.csv: not UTF-8 text .* save it again as 'CSV UTF-8"),
        ("t,ax,ay,az,größe\n0,1,2,3,4\n".encode("latin-1"), "r1.csv: not UTF-8 text"),
        (b"0,1,2,3\n0.1,1,2,4\n", "r1.csv: the first line holds numbers, expected the names of the columns"),
        (b",t,ax,ay,az\n0,0,1,2,3\n", r"r1.csv: found a column without a name.*index=False"),
        (b"t;ax;ay;az\n0;1;2;3\n", "found 't;ax;ay;az' as the first line, expected names separated by commas"),
        (b"t,ax,ay,az\n0,1,2," + 140_000 * b"3", "no table of numbers separated by commas: field larger"),
        (b"\x1b[2J,t\n0,1\n", r"column '\\x1b\[2J' is unknown"),
        (b"", "expected a line with the names of columns, then numbers"),
    ],
)
def test_csv_files_of_other_programs_are_refused_with_advice(tmp_path: Path, text: bytes, message: str) -> None:
    (tmp_path / "r1.csv").write_bytes(text)
    with pytest.raises(RecordingError, match=message):
        read_recording(tmp_path)


def test_two_files_of_one_robot_are_refused(tmp_path: Path) -> None:
    for name in ("r1.csv", "r1.CSV", "r2.csv"):
        (tmp_path / name).write_text("t,ax,ay,az\n0,1,2,3\n0.1,1,2,4\n")
    if len(list(tmp_path.iterdir())) < 3:
        pytest.skip("these names are one file here")
    with pytest.raises(RecordingError, match=r"r1.CSV and r1.csv are both of r1"):
        read_recording(tmp_path)


def test_lines_of_csv_files_are_counted_as_editors_do(tmp_path: Path) -> None:
    (tmp_path / "r1.csv").write_text("\nt,ax,ay,az\n\n0,1,2,x\n")
    with pytest.raises(RecordingError, match="line 4, column 'az': found 'x'"):
        read_recording(tmp_path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("start\n0\n", "holds.csv: found columns start; expected start, end"),
        ("from,to\n0,1\n", "holds.csv: found columns from, to; expected start, end"),
        ("start,end\n5,1\n", "'holds': found one from 5 to 1"),
    ],
)
def test_holds_of_a_folder_are_checked(tmp_path: Path, text: str, message: str) -> None:
    write_recording(example(), tmp_path)
    (tmp_path / "holds.csv").write_text(text)
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


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        (
            "keep.json",
            b"{}",
            "not an .npz file; expected what 'coheft run --save-data' or np.savez writes, a folder of CSV",
        ),
        ("PK.npz", b"PKPKPKPK", "not an .npz file; expected"),
        ("empty.npz", b"", "not an .npz file; expected"),
    ],
)
def test_no_one_is_told_to_trust_files_of_other_kinds(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(RecordingError, match=message) as error:
        read_recording(tmp_path / name)
    assert "pickle" not in str(error.value)


def test_other_files_of_numpy_and_damaged_ones_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "one.npy", np.zeros((10, 6)))
    with pytest.raises(RecordingError, match=r"a single array of shape \(10, 6\), expected an \.npz file"):
        read_recording(tmp_path / "one.npy")
    write_recording(example(), tmp_path / "good.npz")
    good = (tmp_path / "good.npz").read_bytes()
    damaged = tmp_path / "damaged.npz"
    for place in range(0, len(good), 97):
        for cut in (good[:place], good[:place] + bytes([good[place] ^ 0x55]) + good[place + 1 :]):
            damaged.write_bytes(cut)
            try:
                same_samples(example(), read_recording(damaged))  # not all bytes matter
            except RecordingError as error:
                assert str(damaged) in str(error)  # noqa: PT017
    with zipfile.ZipFile(damaged, "w") as file:  # numpy takes the header for Python
        file.writestr("left/t.npy", (tmp_path / "one.npy").read_bytes().replace(b"}", b" "))
    with pytest.raises(RecordingError, match=r"not an \.npz file of numbers"):
        read_recording(damaged)
    with zipfile.ZipFile(damaged, "w") as file:
        for name in ("left/t", "left/t.npy"):
            file.writestr(name, (tmp_path / "one.npy").read_bytes())
    with pytest.raises(RecordingError, match="an array is there more than once"):
        read_recording(damaged)


@pytest.mark.parametrize(("size", "is_refused"), [(1.0, True), (9810.0, True), (1.62, False), (0.0, False)])
def test_gravity_is_that_of_planets(size: float, is_refused: bool) -> None:
    gravity = np.array([0.0, 0.0, -size])
    if is_refused:
        with pytest.raises(RecordingError, match=r"'gravity' is .* m/s², expected about 9.81"):
            gravity_of(gravity)
    else:
        assert gravity_of(gravity) is gravity


def test_one_file_twice_is_no_second_robot() -> None:
    right = held_recording(1, 3)
    robots = {**right.robots, "r3": right.robots["r1"]}
    with pytest.raises(RecordingError, match="r1 and r3 recorded exactly the same"):
        identify(replace(right, robots=robots))


def test_times_that_32_bits_cannot_hold_are_named() -> None:
    time = (1.79e9 + np.arange(10) / 100.0).astype(np.float32).astype(np.float64)
    robots = {name: RobotRecord(time, twist=np.zeros((10, 6))) for name in ("r1", "r2")}
    with pytest.raises(RecordingError, match="numbers of 32 bits have too few digits"):
        check_recording(Recording(robots))
