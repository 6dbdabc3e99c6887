"""Times of recordings: their unit, and resampling at common ones; changes are logged.

Times are in seconds, unless samples would be too slow to be useful, or no sample is at those times.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from coheft.errors import RecordingError
from coheft.estimation.batch.alignment import Stream, aligned
from coheft.estimation.batch.recording import RobotRecord, check_samples, is_regular
from coheft.estimation.geometry.spatial import Array
from coheft.wire.process.log import LOG

_UNITS = ((1.0, "seconds"), (1e-3, "milliseconds"), (1e-6, "microseconds"), (1e-9, "nanoseconds"))
_SLOWEST = 0.25
"""Longest time between samples that is useful [s]."""
_FASTEST = 1e-5
"""Time between samples below which no sensor measures [s]."""
_INDEX = "; numbers of samples are no times"
_ROUNDING = 1e-9
_SHORTEST = 0.2
"""Shortest hold by which another unit than seconds is recognised [s]."""
_EPOCH = 1e8
"""Larger times are those of a clock that counts from 1970 [s]: three years."""


def samples_in_seconds(name: str, time: Array) -> Array:
    """Return a robot's times (n,), in any unit, in seconds; another unit is logged, or refused if it is not known."""
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
    if 0.0 < step < _FASTEST:
        raise RecordingError(
            f"'t' of {name} grows by {step:.3g} from sample to sample, which would make {1.0 / step:.3g} samples per "
            f"second: expected seconds (or ms, µs or ns); multiply days, as spreadsheets count them, by 86400"
        )
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


def streams_of_robot(robot: RobotRecord) -> dict[str, Stream]:
    """Return a robot's recorded channels separately."""
    return {channel: Stream(robot.time, values) for channel, values in robot.channels.items()}


def at_common_times(robots: Mapping[str, RobotRecord]) -> dict[str, RobotRecord]:
    """Resample robots whose times are unsteady, have gaps, or differ from robot to robot; others stay as they are."""
    times = [robot.time for robot in robots.values()]
    if not times or any(len(time) < 2 or np.diff(time).min() <= 0.0 for time in times) or is_regular(times):
        return dict(robots)
    for name, robot in robots.items():
        check_samples(name, robot)
    return _aligned({name: streams_of_robot(robot) for name, robot in robots.items()})


def align(streams: Mapping[str, Mapping[str, Stream]]) -> tuple[dict[str, RobotRecord], float]:
    """Resample all sensors of streams, by robot and channel, at the same times; return what was taken from times [s].

    Times that count from 1970 then count from the first sample.
    """
    starts = [float(stream.time[0]) for own in streams.values() for stream in own.values() if len(stream.time)]
    since = max(starts, default=0.0)
    if since > _EPOCH:
        LOG.warning(f"coheft: times count from the first that all sensors have measured, which is {since:.3f} s of ROS")
        streams = {
            robot: {channel: replace(stream, time=stream.time - since) for channel, stream in own.items()}
            for robot, own in streams.items()
        }
    else:
        since = 0.0
    return _aligned(streams), since


def _aligned(streams: Mapping[str, Mapping[str, Stream]]) -> dict[str, RobotRecord]:
    robots, remarks = aligned(streams)
    for remark in remarks:
        LOG.warning(f"coheft: {remark}")
    return robots
