"""Identification in Python: of files and of arrays, as the command does it."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

import coheft
from coheft.errors import RecordingError, UsageError
from coheft.estimation.measurement import SensorNoise
from coheft.wire.data.file import load_arrays, write_recording
from tests.estimation.batch_team import LOAD, exact_signals, grasps, sensors_recording


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rng = np.random.default_rng(3)
    path = tmp_path_factory.mktemp("recording") / "own.npz"
    write_recording(sensors_recording(rng, exact_signals(rng, grasps(rng, 3)), SensorNoise()), path)
    return path


def test_files_and_arrays_give_the_same(file):
    of_file, of_arrays = coheft.identify(file), coheft.identify(load_arrays(file))
    assert of_file.payload.mass_kg == pytest.approx(LOAD.mass, abs=6.0 * of_file.payload.mass_std_kg)
    assert of_file.recording == str(file)
    assert msgspec.structs.replace(of_arrays, recording=of_file.recording) == of_file


def test_what_cannot_be_used_is_refused(file):
    arrays = load_arrays(file)
    with pytest.raises(RecordingError, match=r"^arrays: found 1 robot"):
        coheft.identify({key: values for key, values in arrays.items() if key.startswith("r1/")})
    with pytest.raises(RecordingError, match=r"^arrays: not a recording: 'r1/t' holds values of type"):
        coheft.identify(arrays | {"r1/t": ["now", "then"]})
    with pytest.raises(UsageError, match="--calibrate"):
        coheft.identify(arrays, bounds=coheft.Bounds())
    with pytest.raises(UsageError, match="arrays have none"):
        coheft.identify(arrays, topics=["r1=/wrench"])
