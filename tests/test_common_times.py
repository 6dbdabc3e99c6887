"""Recordings whose samples were not taken at the same regular times: resampled where that is sound, which is said."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from coheft.app.identify.methods import identify
from coheft.errors import RecordingError
from coheft.estimation.batch.alignment import Stream, aligned
from coheft.estimation.geometry.spatial import Array
from coheft.wire.data.checks import COLUMNS
from coheft.wire.data.file import read_recording

from . import bar

REGULAR = np.arange(0.0, 20.0, 0.01)


def jittered(share: float) -> Callable[[int], Array]:
    """Times of robot ``k``, off by up to a share of the period."""

    def times(k: int) -> Array:
        return REGULAR + 0.01 * np.random.default_rng(k).uniform(-share, share, len(REGULAR))

    return times


def write(path: Path, times: Callable[[int], Array]) -> Path:
    """The bar's two robots with these times, as a folder of CSV files, or an ``.npz`` file if the path says so."""
    arrays = {}
    for k, robot in enumerate(bar.ENDS):
        time = times(k)
        wrench = bar.wrenches(time)[:, [3, 4, 5, 0, 1, 2]]
        arrays |= {f"{robot}/t": time, f"{robot}/pose": bar.poses(time, robot), f"{robot}/wrench": wrench}
        if not path.suffix:
            path.mkdir(exist_ok=True)
            header = ",".join(["t", *COLUMNS["pose"], *COLUMNS["wrench"]])
            rows = np.column_stack([arrays[f"{robot}/{part}"] for part in ("t", "pose", "wrench")])
            np.savetxt(path / f"{robot}.csv", rows, delimiter=",", header=header, comments="")
    if path.suffix:
        np.savez(path, **arrays)  # type: ignore[arg-type]
    return path


@pytest.mark.parametrize("name", ["folder", "file.npz"])
@pytest.mark.parametrize(
    ("times", "words"),
    [
        (
            lambda _: jittered(0.05)(0),
            "not taken at regular times, but 9.024 to 10.97 ms after one another: all are re",
        ),
        (jittered(0.4), "samples are not taken at the same regular times, but"),
        (lambda k: np.round(REGULAR + 0.004 * k, 4), "all are resampled at 100 samples per second"),
        (lambda k: REGULAR[50 * k :], "only the time that all sensors cover is used, from 0.500 s to 19.990 s"),
        (lambda _: REGULAR[np.arange(len(REGULAR)) % 40 > 0], "but 10 to 20 ms after one another"),
        (lambda _: np.round(np.arange(0.0, 20.0, 1.0 / 60.0), 3), "but 16 to 17 ms after one another"),
    ],
)
def test_unsteady_times_are_resampled_and_told(
    tmp_path: Path, name: str, times: Callable[[int], Array], words: str, caplog: pytest.LogCaptureFixture
) -> None:
    recording = read_recording(write(tmp_path / name, times))
    assert words in caplog.text
    found = identify(recording)
    assert found.doubts == ()
    assert found.payload.inertia.mass == pytest.approx(bar.MASS, rel=3e-4)
    np.testing.assert_allclose(found.payload.inertia.com, [0.5, 0.0, 0.0], atol=3e-4)


def test_samples_that_are_too_close_for_splines_are_merged() -> None:
    """With noise, a spline through them would swing far beyond it."""
    rng = np.random.default_rng(1)
    time = np.sort(REGULAR + 0.01 * rng.normal(scale=0.4, size=len(REGULAR)))
    noise = rng.normal(size=(len(time), 6))
    streams = {name: {"wrench": Stream(time, noise)} for name in ("left", "right")}
    robots, _ = aligned(streams)
    wrench = robots["left"].wrench
    assert wrench is not None
    assert wrench.std() < 2.0
    assert np.abs(wrench).max() < 12.0


def test_regular_times_stay_as_they_are(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    assert np.array_equal(read_recording(write(tmp_path / "file.npz", lambda _: REGULAR)).time, REGULAR)
    assert caplog.text == ""


def test_gaps_are_told_and_the_longest_part_is_used(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    kept = REGULAR[((REGULAR < 3.0) | (REGULAR > 3.5)) & ((REGULAR < 5.0) | (REGULAR > 5.2))]
    recording = read_recording(write(tmp_path / "file.npz", lambda _: kept))
    assert (recording.time[0], recording.time[-1]) == (pytest.approx(5.21), pytest.approx(19.99))
    assert "there are no samples from 2.990 s to 3.510 s, from 4.990 s to 5.210 s: only the longest part" in caplog.text


@pytest.mark.parametrize(
    ("times", "words"),
    [
        (lambda k: REGULAR + 1000.0 * k, "'pose' of right begins at 1000 s, when 'pose' of left has ended, at 19.99 s"),
        (lambda _: np.floor(REGULAR), "expected times that grow"),
        (
            lambda _: 0.1 * (np.arange(2000) // 10) + 0.001 * (np.arange(2000) % 10),
            "'pose' of left: samples come in bunches, 1 ms after one another and then not for 91 ms: expected times of",
        ),
    ],
)
def test_times_that_fit_no_clock_are_refused(tmp_path: Path, times: Callable[[int], Array], words: str) -> None:
    with pytest.raises(RecordingError, match=words):
        read_recording(write(tmp_path / "file.npz", times))
