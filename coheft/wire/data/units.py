"""Units of times: seconds, unless samples would be too slow to be useful, or no sample is at those times."""

from collections.abc import Mapping, Sequence

import numpy as np

from coheft.errors import RecordingError
from coheft.estimation.batch.recording import RobotRecord
from coheft.estimation.geometry.spatial import Array
from coheft.wire.process.log import LOG

_UNITS = ((1.0, "seconds"), (1e-3, "milliseconds"), (1e-6, "microseconds"), (1e-9, "nanoseconds"))
_SLOWEST = 0.25
"""Longest time between samples that is useful [s]."""
_INDEX = "; numbers of samples are no times"
_ROUNDING = 1e-9
_SHORTEST = 0.2
"""Shortest hold by which another unit than seconds is recognised [s]."""


def samples_in_seconds(name: str, time: Array) -> Array:
    """Return a robot's times (n,), in any unit, in seconds; another unit is logged."""
    if len(time) < 2:
        return time
    step = float(np.median(np.diff(time)))
    for factor, unit in _UNITS[1:]:
        if step * factor <= _SLOWEST < 1e3 * step * factor:
            LOG.warning(
                f"coheft: 't' of {name} grows by {step:g} from sample to sample: taken for {unit}, which makes "
                f"{1.0 / (step * factor):.4g} samples per second{_INDEX if step == 1.0 else ''}"
            )
            return time * factor
    return time


def span_of(robots: Mapping[str, RobotRecord]) -> tuple[float, float]:
    """Return the first and the last time at which any robot recorded samples [s]; (0, 0) if none did."""
    times = np.concatenate([np.zeros(0), *(robot.time for robot in robots.values())])
    return (float(times.min()), float(times.max())) if len(times) else (0.0, 0.0)


def holds_in_seconds(
    name: str, holds: Sequence[tuple[float, float]], span: tuple[float, float]
) -> tuple[tuple[float, float], ...]:
    """Return holds in seconds; another unit is logged.

    The unit is the one with which most holds are within the recorded time; without such a unit, they do not belong to
    this recording.

    ``name`` is that of their source in messages, ``span`` the first and the last recorded time [s].
    """
    if not holds:
        return ()
    array = np.array(holds)
    slack = _ROUNDING * max(map(abs, span)) + _SLOWEST
    starts, ends = (np.outer([factor for factor, _ in _UNITS], times) for times in array.T)
    is_long = (ends - starts >= _SHORTEST) | (np.arange(len(_UNITS)) == 0)[:, None]
    within = np.count_nonzero((starts >= span[0] - slack) & (ends <= span[1] + slack) & is_long, axis=1)
    touching = np.count_nonzero((ends > span[0]) & (starts < span[1]) & is_long, axis=1)
    best = int(np.argmax(within if within.any() else touching))
    if not within[best] and not touching[best]:
        raise RecordingError(
            f"{name}: holds are from {array.min():g} to {array.max():g}, but samples from {span[0]:g} s to "
            f"{span[1]:g} s: expected times by the same clock, in seconds (or in ms, µs or ns)"
        )
    factor, unit = _UNITS[best]
    if best:
        LOG.warning(
            f"coheft: {name}: holds are from {array.min():g} to {array.max():g}: taken for {unit}, as samples are from "
            f"{span[0]:g} s to {span[1]:g} s"
        )
    return tuple((factor * start, factor * end) for start, end in holds)
