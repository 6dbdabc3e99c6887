"""Sensors that are sampled at times of their own, brought to the same regular times: topics of ROS come like that."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from coheft.errors import RecordingError
from coheft.estimation.batch.recording import RobotRecord
from coheft.estimation.geometry.spatial import Array

_GAP_STEPS, _GAP = 3.5, 0.05
"""Longest time without a sample that is bridged, in steps of the sensor, or [s] if that is more."""
_SAME = 1e-3
"""Share of a step by which times may differ that count as the same."""
_FASTER = 1.5
"""Sensors that are so many times as fast as the slowest are filtered before fewer of their samples are taken,"""
_ALIAS = 0.4
"""at this share of the slowest one's rate."""
_FEWEST = 4


@dataclass(frozen=True, eq=False)
class Stream:
    """What one sensor measured.

    Attributes:
        time: Of its samples, growing, shape (n,) [s].
        values: Shape (n, width), columns as in ``RobotRecord``.
    """

    time: Array
    values: Array

    @property
    def step(self) -> float:
        """Mean time from sample to sample [s]: the usual one may be far shorter, if samples come in bursts."""
        return float((self.time[-1] - self.time[0]) / (len(self.time) - 1))

    @property
    def gaps(self) -> list[tuple[float, float]]:
        """From when to when there are no samples for too long [s]."""
        steps = np.diff(self.time)
        found = np.flatnonzero(steps > max(_GAP_STEPS * float(np.median(steps)), _GAP))
        return [(float(self.time[k]), float(self.time[k + 1])) for k in found]

    def between(self, start: float, end: float) -> Stream:
        """The samples from some time to another, with those just outside, if there are none just there."""
        first = max(0, int(np.searchsorted(self.time, start, "right")) - 1)
        last = min(len(self.time), int(np.searchsorted(self.time, end, "left")) + 1)
        return Stream(self.time[first:last], self.values[first:last])


def aligned(streams: Mapping[str, Mapping[str, Stream]]) -> tuple[dict[str, RobotRecord], list[str]]:
    """Bring all sensors of all robots to the times of the slowest one, by splines, within the time that all cover.

    What lies beyond a gap in any of them is left out: the longest part without gaps remains.

    Args:
        streams: By robot and channel, an attribute of ``RobotRecord``.

    Returns:
        The robots, all with the same times, and what the reader should know of it, in words.

    Raises:
        RecordingError: There are too few samples, or no time that all sensors cover; says which sensor's.
    """
    named = {f"'{channel}' of {robot}": s for robot, own in streams.items() for channel, s in own.items()}
    for name, stream in named.items():
        if len(stream.time) < _FEWEST:
            raise RecordingError(f"{name}: found {len(stream.time)} samples, expected at least {_FEWEST}")
        if not (np.diff(stream.time) > 0.0).all():
            raise RecordingError(f"{name}: expected times that grow: sort the samples, and remove what is there twice")
    start, end, remarks = _covered(named)
    streams = {robot: {c: s.between(start, end) for c, s in own.items()} for robot, own in streams.items()}
    named = {f"'{channel}' of {robot}": s for robot, own in streams.items() for channel, s in own.items()}
    slowest = max(named, key=lambda name: named[name].step)
    time = _common_times(named.values(), start, end)
    if time is None:
        step = named[slowest].step
        count = int((end - start) / step + _SAME) + 1
        if count < _FEWEST or min(len(stream.time) for stream in named.values()) < _FEWEST:
            raise RecordingError(f"all sensors together cover {start:g} s to {end:g} s: too little. Record for longer")
        time = start + step * np.arange(count, dtype=np.float64)
        remarks.append(
            f"sensors are sampled at times of their own: brought to those of a grid of {1.0 / step:.4g} samples per "
            f"second, the rate of {slowest}"
        )
    return {robot: _record(own, time) for robot, own in streams.items()}, remarks


def _record(streams: Mapping[str, Stream], time: Array) -> RobotRecord:
    return RobotRecord(time, **{name: _at(stream, time, name == "pose") for name, stream in streams.items()})


def _covered(streams: Mapping[str, Stream]) -> tuple[float, float, list[str]]:
    """The longest time that all streams cover without gaps, from when to when [s], and remarks on what is left out."""
    first = max(streams, key=lambda name: float(streams[name].time[0]))
    last = min(streams, key=lambda name: float(streams[name].time[-1]))
    start, end = float(streams[first].time[0]), float(streams[last].time[-1])
    if start >= end:
        raise RecordingError(
            f"{first} begins at {start:g} s, when {last} has ended, at {end:g} s: expected sensors that measure at the "
            f"same time. Are their clocks set alike?"
        )
    gaps = sorted(
        (begin, over, name)
        for name, stream in streams.items()
        for begin, over in stream.gaps
        if over > start and begin < end
    )
    if not gaps:
        return start, end, []
    # Parts begin where all gaps before have ended.
    parts, since = [], start
    for begin, over, _ in gaps:
        parts.append((since, begin))
        since = max(since, over)
    parts.append((since, end))
    start, end = max(parts, key=lambda part: part[1] - part[0])
    begin, over, name = max(gaps, key=lambda gap: gap[1] - gap[0])
    many = f", the longest of {len(gaps)} gaps" if len(gaps) > 1 else ""
    return (
        start,
        end,
        [
            f"{name} has no samples from {begin:.3f} s to {over:.3f} s{many}: only the longest part without gaps is "
            f"used, from {start:.3f} s to {end:.3f} s"
        ],
    )


def _common_times(streams: Iterable[Stream], start: float, end: float) -> Array | None:
    """The streams' own times, if all have the same, at equal steps."""
    times = [s.time[(s.time >= start - _SAME * s.step) & (s.time <= end + _SAME * s.step)] for s in streams]
    first = times[0]
    if len(first) < _FEWEST or any(len(time) != len(first) for time in times):
        return None
    step = float((first[-1] - first[0]) / (len(first) - 1))
    regular = first[0] + step * np.arange(len(first))
    return regular if all(np.abs(time - regular).max() <= _SAME * step for time in times) else None


def _at(stream: Stream, time: Array, is_pose: bool) -> Array:
    """Values at other times, equally far apart: (m, width)."""
    from scipy.interpolate import CubicSpline  # servers write recordings without it

    from coheft.estimation.batch.signals import low_pass, without_jumps

    own, values = stream.time, stream.values
    if is_pose:
        values = np.hstack([values[:, :3], without_jumps(values[None, :, 3:])[0]])
    step = float((time[-1] - time[0]) / (len(time) - 1))
    if step > _FASTER * stream.step:
        own = np.arange(own[0], own[-1], stream.step)
        values = low_pass(CubicSpline(stream.time, values)(own), 1.0 / stream.step, _ALIAS / step)
    found: Array = values if np.array_equal(own, time) else CubicSpline(own, values)(time)
    if is_pose:
        with np.errstate(over="ignore"):
            lengths = np.linalg.norm(found[:, 3:], axis=1, keepdims=True)
        is_unit = np.abs(lengths - 1.0) < 0.01  # others were none: let the checks refuse them
        found = np.hstack([found[:, :3], found[:, 3:] / np.where(is_unit, lengths, 1.0)])
    return found
