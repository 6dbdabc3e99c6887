"""Holds may be in another unit than samples."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from coheft.errors import RecordingError
from coheft.wire.data.file import read_recording


def write(folder: Path, factor: float, holds: str, first: float = 5.0) -> None:
    """Two robots from 5 s to 25 s, in some unit."""
    for name in ("r1", "r2"):
        lines = [f"{factor * (first + k / 10.0):.17g},1,2,3" for k in range(201)]
        (folder / f"{name}.csv").write_text("\n".join(["t,ax,ay,az", *lines]))
    (folder / "holds.csv").write_text(f"start,end\n{holds}\n")


@pytest.mark.parametrize("samples", [1.0, 1e3, 1e9])
@pytest.mark.parametrize(
    ("factor", "unit"), [(1.0, ""), (1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanosec")]
)
def test_the_unit_is_the_one_in_which_something_was_recorded(
    tmp_path: Path, samples: float, factor: float, unit: str, caplog: pytest.LogCaptureFixture
) -> None:
    write(tmp_path, samples, f"{6 * factor:.0f},{12 * factor:.0f}\n{15 * factor:.0f},{24 * factor:.0f}")
    assert np.array(read_recording(tmp_path).holds) == pytest.approx(np.array([(6.0, 12.0), (15.0, 24.0)]))
    assert (f"holds.csv: holds are from {6 * factor:g} to {24 * factor:g}: taken for {unit}" in caplog.text) == bool(
        unit
    )


def test_npz_files_have_them_as_well(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    own = {"t": 5000.0 + 100.0 * np.arange(201), "acceleration": np.ones((201, 3))}
    arrays = {f"{name}/{key}": values for name in ("r1", "r2") for key, values in own.items()}
    np.savez(tmp_path / "x.npz", holds=[[6000.0, 12000.0]], **arrays)  # type: ignore[arg-type]
    assert np.array(read_recording(tmp_path / "x.npz").holds) == pytest.approx(np.array([(6.0, 12.0)]))
    assert "'holds': holds are from 6000 to 12000: taken for milliseconds" in caplog.text


@pytest.mark.parametrize("first", [0.0, 5.0])
def test_holds_of_another_recording_are_refused(tmp_path: Path, first: float) -> None:
    """Holds of some milliseconds are none."""
    write(tmp_path, 1.0, "100,110", first)
    with pytest.raises(RecordingError, match=r"holds.csv: holds are from 100 to 110, but samples from "):
        read_recording(tmp_path)
