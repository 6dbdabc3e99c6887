"""Identification of a load from a recording in a file or in arrays, for the command and the Python interface."""

from collections.abc import Mapping
from dataclasses import asdict
from math import inf
from pathlib import Path

import numpy.typing as npt

from coheft.app.identify.choices import Bounds, Options
from coheft.app.identify.inputs import read_any, read_holds
from coheft.app.identify.methods import identify, part_of
from coheft.errors import UsageError, recording_errors
from coheft.estimation.batch.identification import Identification
from coheft.estimation.batch.recording import Recording
from coheft.estimation.batch.statics import Statics
from coheft.wire.data.file import recording_of
from coheft.wire.data.statics import statics_of

ARRAYS = "arrays"
"""Name of a recording without a file, in errors and reports."""
_MOST = {"misalignment_deg": 90.0, "force_offset": inf}
"""Limits of bounds [degrees, N]; those of scales are less than 1."""


def evaluate(recording: Path | Mapping[str, npt.ArrayLike], options: Options) -> tuple[Recording, Identification]:
    """Identify the load of a recording.

    Returns:
        The part of the recording that was used, and the identification.

    Raises:
        RecordingError: It cannot be read, or cannot be a recording of one load; the message says why.
        UsageError: Options contradict each other.
    """
    holds, is_static = options.holds, options.method == "static"
    if options.bounds is not None and not options.calibrate:
        raise UsageError("bounds are of errors that --calibrate estimates: add it, or leave them out")
    for name, bound in asdict(options.bounds or Bounds()).items():
        most = _MOST.get(name, 1.0)
        if not 0.0 <= bound < most:
            raise UsageError(f"--{name.replace('_', '-')} {bound:g}: expected a bound from 0 to less than {most:g}")
    if is_static and (holds is not None or options.from_ is not None or options.to is not None):
        raise UsageError("--method static takes all holds of RECORDING: leave --holds, --from and --to out")
    statics: Statics | None = None
    if isinstance(recording, Mapping):
        if options.topics:
            raise UsageError("--topics chooses among those of an MCAP file or a bag of ROS, but arrays have none")
        with recording_errors(ARRAYS):
            statics = statics_of(recording) if is_static else None
            recorded = statics.as_recording() if statics else recording_of(recording)
    elif is_static and not options.topics:
        statics = read_holds(recording)
        recorded = statics.as_recording()
    else:
        recorded = read_any(recording, options.topics)
    if holds is not None:
        statics = read_holds(holds, recorded.names)
    with recording_errors(ARRAYS if isinstance(recording, Mapping) else recording):
        recorded = part_of(recorded, options.from_, options.to)
        return recorded, identify(recorded, options, statics)
