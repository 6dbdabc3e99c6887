"""Combination of sensors that were recorded separately to one recording; changes of times are logged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from coheft.estimation.batch.alignment import Stream, aligned
from coheft.estimation.batch.recording import RobotRecord
from coheft.wire.process.log import LOG

_EPOCH = 1e8
"""Larger times are those of a clock that counts from 1970 [s]: three years."""


def align(streams: Mapping[str, Mapping[str, Stream]]) -> tuple[dict[str, RobotRecord], float]:
    """Resample all sensors at the same times; times that count from 1970 then count from the first sample.

    Args:
        streams: Streams by robot and channel.

    Returns:
        The robots, and what was taken from their times [s].

    Raises:
        RecordingError: There are too few samples, or no time that all sensors cover.
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
    robots, remarks = aligned(streams)
    for remark in remarks:
        LOG.warning(f"coheft: {remark}")
    return robots, since
