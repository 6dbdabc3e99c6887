"""A recording from wherever it is to what was found, for the command and for programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy.typing as npt

from coheft.app.identify.choices import Bounds, Method
from coheft.app.identify.inputs import read_any, read_holds
from coheft.app.identify.methods import identify, part_of
from coheft.errors import RecordingError, UsageError
from coheft.estimation.batch.identification import Identification
from coheft.estimation.batch.recording import Recording, check_recording
from coheft.estimation.batch.statics import Statics
from coheft.wire.data.file import recording_of

ARRAYS = "arrays"
"""What errors and reports call a recording that is no file."""


def evaluate(
    recording: Path | Mapping[str, npt.ArrayLike],
    *,
    method: Method | None = None,
    calibrate: bool = False,
    bounds: Bounds | None = None,
    from_: float | None = None,
    to: float | None = None,
    cutoff: float | None = None,
    topics: Sequence[str] = (),
    holds: Path | None = None,
    assume: str | None = None,
) -> tuple[Recording, Identification]:
    """Identify the load of a recording; arguments as of ``coheft identify``.

    Returns:
        The part of the recording that was used, and what was found.

    Raises:
        RecordingError: It cannot be read, or cannot be a recording of one load; says what, and why.
        UsageError: Arguments contradict each other.
    """
    if bounds is not None and not calibrate:
        raise UsageError("bounds are of errors that --calibrate estimates: add it, or leave them out")
    if method == "static" and (holds is not None or from_ is not None or to is not None):
        raise UsageError("--method static takes all holds of RECORDING: leave --holds, --from and --to out")
    statics: Statics | None = None
    if isinstance(recording, Mapping):
        recorded = _of_arrays(recording, topics)
    elif method == "static" and not topics:
        statics = read_holds(recording)
        recorded = statics.as_recording()
    else:
        recorded = read_any(recording, topics)
    if holds is not None:
        statics = read_holds(holds, recorded.names)
    try:
        recorded = part_of(recorded, from_, to)
        limits = (bounds or Bounds()) if calibrate else None
        return recorded, identify(recorded, method, limits, cutoff, statics, assume)
    except RecordingError as error:
        raise RecordingError(f"{ARRAYS if isinstance(recording, Mapping) else recording}: {error}") from error


def _of_arrays(arrays: Mapping[str, npt.ArrayLike], topics: Sequence[str]) -> Recording:
    if topics:
        raise UsageError("--topics chooses among those of an MCAP file or a bag of ROS, but arrays have none")
    try:
        recorded = recording_of(arrays)
        check_recording(recorded)
    except RecordingError as error:
        raise RecordingError(f"{ARRAYS}: {error}") from error
    return recorded
