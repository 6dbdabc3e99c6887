"""Identification in Python: of files and of arrays, as the command does it."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

import coheft
from coheft.errors import RecordingError, UsageError
from coheft.wire.data.file import load_arrays
from tests.ring3_recording import MASS, ring3_arrays
from tests.statics import MASS as HELD_MASS
from tests.statics import statics


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "own.npz"
    np.savez(path, **ring3_arrays())
    return path


def test_files_and_arrays_give_the_same(file):
    of_file, of_arrays = coheft.identify(file), coheft.identify(ring3_arrays())
    assert of_file.doubts == []
    assert of_file.payload.mass_kg == pytest.approx(MASS, abs=6.0 * of_file.payload.mass_std_kg)
    assert of_file.payload.mass_std_kg < 0.01
    assert of_file.recording == str(file)
    assert msgspec.structs.replace(of_arrays, recording=of_file.recording) == of_file


def test_holds_without_times_are_identified():
    held = statics()
    arrays = {f"{name}/pose": robot.pose for name, robot in held.robots.items()}
    arrays |= {f"{name}/wrench": robot.wrench[:, [3, 4, 5, 0, 1, 2]] for name, robot in held.robots.items()}
    found = coheft.identify(arrays, method="static")
    assert found.payload.mass_kg == pytest.approx(HELD_MASS, abs=5.0 * found.payload.mass_std_kg)
    with pytest.raises(RecordingError, match=r"^arrays: 't' of a: found shape \(5,\), expected \(6,\), or none"):
        coheft.identify(arrays | {"a/t": np.arange(5.0)}, method="static")
    with pytest.raises(RecordingError, match=r"^arrays: 'pose' of a: found shape \(\), expected \(1, 7\)"):
        coheft.identify({**arrays, **{f"{name}/pose": 0.0 for name in held.names}}, method="static")


def test_what_cannot_be_used_is_refused(file):
    arrays = load_arrays(file)
    with pytest.raises(RecordingError, match=r"^arrays: 'r1/t': expected an array of numbers: .* inhomogeneous"):
        coheft.identify({**arrays, "r1/t": [[0.0, 0.1], [0.2]]})
    with pytest.raises(RecordingError, match=r"^arrays: found 1 robot"):
        coheft.identify({key: values for key, values in arrays.items() if key.startswith("r1/")})
    with pytest.raises(RecordingError, match=r"^arrays: not a recording: 'r1/t' holds values of type"):
        coheft.identify(arrays | {"r1/t": ["now", "then"]})
    with pytest.raises(UsageError, match="--calibrate"):
        coheft.identify(arrays, bounds=coheft.Bounds())
    with pytest.raises(UsageError, match="arrays have none"):
        coheft.identify(arrays, topics=["r1=/wrench"])
