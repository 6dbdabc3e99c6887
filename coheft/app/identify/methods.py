"""Identification of a load from any recording, in files or in arrays: choice of a method, and calls of all methods."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from importlib import import_module
from math import inf
from pathlib import Path

import numpy as np
import numpy.typing as npt

from coheft.app.identify.choices import Bounds, Method, Options
from coheft.errors import RecordingError, UsageError, recording_errors
from coheft.estimation.batch.holds import means_in_holds
from coheft.estimation.batch.identification import Identification
from coheft.estimation.batch.identify import identify_batch, identify_sensors, identify_with_instruments
from coheft.estimation.batch.identify_poses import identify_poses
from coheft.estimation.batch.identify_statics import identify_statics, with_statics
from coheft.estimation.batch.judge.band import cutoff_for
from coheft.estimation.batch.judged import judged
from coheft.estimation.batch.recording import Recording
from coheft.estimation.batch.signals import CUTOFF, PAPER_CUTOFF
from coheft.estimation.batch.wrist_poses import Tolerances
from coheft.wire.data.file import read_recording, recording_of
from coheft.wire.data.statics import read_statics, statics_of

_BEST = Options()
ARRAYS = "arrays"
"""Name of a recording without a file, in errors and reports."""
_MOST = {"misalignment_deg": 90.0, "force_offset": inf}
"""Limits of bounds [degrees, N]; those of scales are less than 1."""
_OF_TOPICS = (".mcap", ".bag", ".db3")
_TABLES = ".csv"
_METADATA = "metadata.yaml"
"""File in each bag of ROS 2, which is a folder."""


def suitable(recording: Recording) -> Method:
    """The best method for what was recorded."""
    if recording.has("pose"):
        return "pose"
    if recording.has("acceleration") and recording.has("twist") and recording.noise is not None:
        return "likelihood"
    return "instruments"


def part_of(recording: Recording, start: float | None, end: float | None) -> Recording:
    """The samples from ``--from`` to ``--to`` [s]; None for the begin or the end of the recording.

    Raises:
        UsageError: The times are in the wrong order, or outside the recording.
    """
    if start is not None and end is not None and start >= end:
        raise UsageError(f"--from {start:g} is not before --to {end:g}: give the earlier time first")
    time, step = recording.time, 1.5 / recording.rate
    for option, given in (("--from", start), ("--to", end)):
        if given is not None and not time[0] - step <= given <= time[-1] + step:
            raise UsageError(f"{option} {given:g} is outside the recording, which is from {recording.span}")
    if start is None and end is None:
        return recording
    return recording.between(float(time[0] if start is None else start), float(time[-1] if end is None else end))


def identify(recording: Recording, options: Options = _BEST, statics: Recording | None = None) -> Identification:
    """Identify the load, and judge the recording.

    ``statics`` are the means in holds of the same robots that were recorded separately.

    Raises:
        RecordingError: The recording lacks what the method needs, or its numbers make the computation fail.
        UsageError: The method does not support an option.
    """
    method = options.method or suitable(recording)
    _check(method, options, statics)
    try:
        if method == "static":
            return fitted(recording, method, options, statics)
        cutoff = options.cutoff or cutoff_for(recording)
        used = options if method == "batch" else replace(options, cutoff=cutoff)  # or the cutoff of the paper
        fit = partial(fitted, method=method, options=used, statics=statics)
        found = judged(recording, fit, cutoff, options.assume)
    except (np.linalg.LinAlgError, ArithmeticError) as error:
        raise RecordingError(
            f"--method {method} cannot compute with these numbers ({error}): are some of them huge, or constant "
            f"all the time, or is 'noise' far from what the sensors have? Choose a part in which the load moves with "
            f"--from and --to, or another method"
        ) from error
    if options.cutoff is not None or cutoff == CUTOFF:
        return found
    remark = f"The motion is fast: filters have a cutoff of {cutoff:g} Hz instead of {CUTOFF:g} Hz."
    return replace(found, remarks=(*found.remarks, remark))


def _check(method: Method, options: Options, statics: Recording | None) -> None:
    if options.calibrate and method != "pose":
        raise UsageError(f"calibration errors are estimated by --method pose only, not by {method}")
    if options.calibrate and statics is not None:
        raise UsageError("--calibrate cannot correct holds that were recorded apart: leave it, or --holds, out")
    if options.assume is not None and method == "static":
        raise UsageError("--assume needs a load that moves: --method static does not judge what is wrong")
    if options.cutoff is not None and method in ("likelihood", "static"):
        raise UsageError(f"--method {method} has no filter: leave --cutoff out, or choose another method")


def fitted(
    recording: Recording, method: Method, options: Options = _BEST, statics: Recording | None = None
) -> Identification:
    """Identify the load by a method without judging the recording; arguments and errors as of ``identify``."""
    match method:
        case "batch":
            return identify_batch(recording, options.cutoff or PAPER_CUTOFF, statics)
        case "static":
            return identify_statics(statics or means_in_holds(recording))
        case "instruments":
            found = identify_with_instruments(recording, options.cutoff or CUTOFF)
        case "pose":
            tolerances = Tolerances.of_bounds(**asdict(options.bounds or Bounds())) if options.calibrate else None
            found = identify_poses(recording, tolerances, options.cutoff or CUTOFF)
        case "likelihood":
            found = identify_sensors(recording)
            if options.method is None and found.unsuitable:
                found = _without_noise(recording, options, found)
    return found if statics is None else with_statics(found, statics)


def _without_noise(recording: Recording, options: Options, refuted: Identification) -> Identification:
    """Use instruments instead, which need no noise, if the recording is long enough for them."""
    try:
        found = identify_with_instruments(recording, options.cutoff or CUTOFF)
    except RecordingError:
        return refuted
    remark = f"{refuted.unsuitable}, so that --method likelihood does not suit it."
    return replace(found, remarks=(*found.remarks, remark))


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
    statics: Recording | None = None
    if isinstance(recording, Mapping):
        if options.topics:
            raise UsageError("--topics chooses among those of an MCAP file or a bag of ROS, but arrays have none")
        with recording_errors(ARRAYS):
            statics = statics_of(recording) if is_static else None
            recorded = statics or recording_of(recording)
    elif is_static and not options.topics:
        recorded = statics = read_holds(recording)
    else:
        recorded = read_any(recording, options.topics)
    if holds is not None:
        statics = read_holds(holds, recorded.names)
    with recording_errors(ARRAYS if isinstance(recording, Mapping) else recording):
        recorded = part_of(recorded, options.from_, options.to)
        return recorded, identify(recorded, options, statics)


def read_any(path: Path, topics: Sequence[str] = ()) -> Recording:
    """Read a recording: ``.npz``, a folder of CSV files, an MCAP file, or a bag of ROS.

    ``topics`` names topics of each robot, as ``ROBOT=TOPIC``; without it, the topics' names tell.

    Raises:
        RecordingError: It cannot be read or used; the message says why.
        UsageError: Topics are given for a file that has none.
        MissingPackageError: The packages for reading topics are not installed.
    """
    if _is_of_topics(path):
        import_module("coheft.app.recording")  # raises MissingPackageError
        from coheft.app.identify.topics import read_topics

        return read_topics(path, topics)
    bags = sorted(file for file in path.iterdir() if file.suffix in _OF_TOPICS) if path.is_dir() else []
    if bags:
        raise RecordingError(f"{path}: a bag without {_METADATA}: name its file instead, {bags[0]}")
    if topics:
        raise UsageError(
            f"--topics chooses among those of an MCAP file or a bag of ROS, but {path} is none: leave it out"
        )
    return read_recording(path)


def read_holds(path: Path, names: Sequence[str] | None = None) -> Recording:
    """Read holds that were recorded separately, from any recording, or from a file with a line for each hold.

    ``names`` are the expected robots in their order; None for any. The means in holds are its samples.
    """
    with recording_errors(path):
        means = means_in_holds(read_any(path)) if _is_of_topics(path) else read_statics(path)
        if names is None:
            return means
        if sorted(names) != sorted(means.names):
            raise RecordingError(f"found holds of {', '.join(means.names)}, expected those of {', '.join(names)}")
        return replace(means, robots={name: means.robots[name] for name in names})


def files_of(path: Path) -> list[Path]:
    """The files of a recording, which must not be overwritten."""
    if not path.is_dir():
        return [path]
    return [file for file in path.iterdir() if file.suffix.lower() in (*_OF_TOPICS, _TABLES) or file.name == _METADATA]


def _is_of_topics(path: Path) -> bool:
    return path.suffix in _OF_TOPICS or (path / _METADATA).is_file()
