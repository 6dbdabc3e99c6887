"""Combination of sensors that were recorded separately to one recording; changes of times are logged."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from coheft.estimation.batch.alignment import Stream, aligned
from coheft.estimation.batch.recording import RobotRecord, check_samples, is_regular
from coheft.wire.process.log import LOG

_EPOCH = 1e8
"""Larger times are those of a clock that counts from 1970 [s]: three years."""


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
