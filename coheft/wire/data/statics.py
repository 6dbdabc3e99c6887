"""Holds that are recorded separately: a line, or an interval of samples, for each orientation of the load."""

from collections.abc import Callable, Mapping
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt

from coheft.errors import RecordingError, one_line
from coheft.estimation.batch.holds import means_in_holds
from coheft.estimation.batch.recording import GRAVITY, Recording, check_samples
from coheft.estimation.batch.signals import turns
from coheft.estimation.geometry.spatial import Array
from coheft.wire.data.checks import TIME, record_at
from coheft.wire.data.file import channels_in, load_arrays, read_recording, recording_of
from coheft.wire.data.folder import read_channels

_GAP = 10.0
"""Number of missing samples that separate two holds."""
_TURN = np.radians(2.0)
"""Lines with a larger rotation between them are separate holds [rad]: no robot moves as fast between samples."""
_NEEDED = ("pose", "wrench")


def read_statics(path: Path) -> Recording:
    """Read means in holds, from an ``.npz`` file or a folder of CSV files: poses and wrenches of each robot.

    Without times, or if the load rotates from line to line, each line is a hold. Otherwise a hold lasts until there is
    a gap; if there are no gaps, as long as forces do not change.
    """
    if not path.is_dir():
        return statics_of(load_arrays(path))
    return _statics(read_channels(path), np.array(GRAVITY), partial(read_recording, path))


def statics_of(arrays: Mapping[str, npt.ArrayLike]) -> Recording:
    """Make holds from arrays, by their names in an ``.npz`` file; rules and errors as of ``read_statics``."""
    return _statics(*channels_in(arrays), partial(recording_of, arrays))


def _statics(tables: Mapping[str, Mapping[str, Array]], gravity: Array, whole: Callable[[], Recording]) -> Recording:
    """Holds in robots' channels; ``whole`` is called if these are a recording of which the forces tell the holds."""
    if not tables:
        raise RecordingError("no robots; expected poses and wrenches of each")
    for name, table in tables.items():
        missing = [channel for channel in _NEEDED if channel not in table]
        if missing:
            found = one_line(", ".join(table))
            raise RecordingError(
                f"'{missing[0]}' of {name} is missing; found {found}; expected pose and wrench of holds"
            )
    lengths = {name: len(np.atleast_1d(table["pose"])) for name, table in tables.items()}
    if len(set(lengths.values())) > 1:
        counts = ", ".join(f"{count} of {name}" for name, count in lengths.items())
        raise RecordingError(f"found different numbers of lines: {counts}; expected one for each hold of every robot")
    first = next(iter(tables))
    time = np.arange(lengths[first], dtype=np.float64)
    robots = {name: record_at(time, name, table) for name, table in tables.items()}
    for name, robot in robots.items():
        check_samples(name, robot)
    spans = _spans(tables[first].get(TIME), tables[first]["pose"], first)
    return means_in_holds(whole() if spans is None else Recording(robots, gravity=gravity), spans)


def _spans(time: Array | None, pose: Array, name: str) -> list[tuple[int, int]] | None:
    """Return first and one past the last line of each hold; None if it was recorded without gaps.

    Times (n,) of the lines have any unit; None if not recorded. Poses have the shape (n, 7).
    """
    count = len(pose)
    if time is not None and time.shape != (count,):
        raise RecordingError(f"'{TIME}' of {name}: found shape {time.shape}, expected {(count,)}, or none")
    if time is None or count < 2 or np.median(turns(pose[:-1], pose[1:])) > _TURN:
        return [(k, k + 1) for k in range(count)]
    steps = np.diff(time)
    if not (steps > 0.0).all():
        raise RecordingError(f"'{TIME}' of {name}: expected times that grow, or none")
    gaps = np.flatnonzero(steps > _GAP * np.median(steps)) + 1
    if not len(gaps):
        return None
    return list(pairwise([0, *gaps.tolist(), count]))
