"""Resampling of sensors with different times, such as topics of ROS, at the same regular times."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from coheft.errors import RecordingError
from coheft.estimation.batch.recording import RobotRecord
from coheft.estimation.geometry.spatial import Array

_GAP_STEPS, _GAP = 3.5, 0.05
"""Longest gap that is interpolated, in steps of the sensor, or [s] if that is more."""
_SAME = 1e-3
"""Difference of times that count as the same, as a share of a step."""
_FASTER = 1.5
"""Sensors that are faster than the common rate by this factor are filtered before they are resampled,"""
_ALIAS = 0.4
"""with this share of the common rate as cutoff."""
_CLOSE = 0.3
"""Samples that are closer than this share of the mean step are merged."""
_BUNCHED = 0.05
"""Share of steps that are gaps from which on samples come in bunches."""
_FEWEST = 4
_LOST = 0.1
"""Time at either end that only some sensors cover, which is left out without a remark [s]."""
_SHOWN = 4
"""Largest number of gaps that are named."""


@dataclass(frozen=True, eq=False)
class Stream:
    """Samples of one sensor.

    Attributes:
        time: Increasing times, shape (n,) [s].
        values: Samples, shape (n, width), columns as in ``RobotRecord``.
    """

    time: Array
    values: Array

    @property
    def step(self) -> float:
        """Mean time between samples [s]; the median would be far shorter if samples come in bursts."""
        return float((self.time[-1] - self.time[0]) / (len(self.time) - 1))

    @property
    def gaps(self) -> list[tuple[float, float]]:
        """Begin and end of each gap that is too long to interpolate [s]."""
        steps = np.diff(self.time)
        found = np.flatnonzero(steps > max(_GAP_STEPS * float(np.median(steps)), _GAP))
        return [(float(self.time[k]), float(self.time[k + 1])) for k in found]

    def between(self, start: float, end: float) -> Stream:
        """The samples between two times, and the neighbouring ones outside."""
        first = max(0, int(np.searchsorted(self.time, start, "right")) - 1)
        last = min(len(self.time), int(np.searchsorted(self.time, end, "left")) + 1)
        return Stream(self.time[first:last], self.values[first:last])


def aligned(streams: Mapping[str, Mapping[str, Stream]]) -> tuple[dict[str, RobotRecord], list[str]]:
    """Resample all sensors at the rate of the slowest one, by splines, within the longest part without gaps.

    Returns:
        The robots, all with the same times, and remarks on what was changed.
    """
    named = {f"'{channel}' of {robot}": s for robot, own in streams.items() for channel, s in own.items()}
    for name, stream in named.items():
        if len(stream.time) < _FEWEST:
            raise RecordingError(f"{name}: found {len(stream.time)} samples, expected at least {_FEWEST}")
        if not (np.diff(stream.time) > 0.0).all():
            raise RecordingError(f"{name}: expected times that grow: sort the samples, and remove what is there twice")
        if len(stream.gaps) > _BUNCHED * len(stream.time):
            steps = 1e3 * np.diff(stream.time)
            raise RecordingError(
                f"{name}: samples come in bunches, {np.median(steps):.3g} ms after one another and then not for "
                f"{steps.max():.3g} ms: expected times of measurement, not of arrival"
            )
    start, end, remarks = _covered(named)
    streams = {robot: {c: s.between(start, end) for c, s in own.items()} for robot, own in streams.items()}
    named = {f"'{channel}' of {robot}": s for robot, own in streams.items() for channel, s in own.items()}
    time = _common_times(named.values(), start, end)
    if time is None:
        slowest = max(named, key=lambda name: named[name].step)
        step = named[slowest].step
        count = int((end - start) / step + _SAME) + 1
        if count < _FEWEST or min(len(stream.time) for stream in named.values()) < _FEWEST:
            raise RecordingError(f"all sensors together cover {start:g} s to {end:g} s: too little. Record for longer")
        time = start + step * np.arange(count, dtype=np.float64)
        remarks.append(
            f"{_differences(named.values())}: all are resampled at {1.0 / step:.4g} samples per second, the rate of "
            f"{slowest}"
        )
    robots = {
        robot: RobotRecord(time, **{name: _at(stream, time, name == "pose") for name, stream in own.items()})
        for robot, own in streams.items()
    }
    return robots, remarks


def _differences(streams: Collection[Stream]) -> str:
    """How the times of sensors are not the same regular ones, in words."""
    steps = np.concatenate([np.diff(stream.time) for stream in streams])
    first = next(iter(streams))
    are_same = all(np.array_equal(stream.time, first.time) for stream in streams)
    return (
        f"samples are not taken at {'regular' if are_same else 'the same regular'} times, but {1e3 * steps.min():.4g} "
        f"to {1e3 * steps.max():.4g} ms after one another"
    )


def _covered(streams: Mapping[str, Stream]) -> tuple[float, float, list[str]]:
    """Begin and end of the longest part without gaps that all streams cover [s], and remarks on what is left out."""
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
        lost = max(max(s.time[-1] - end, start - s.time[0]) for s in streams.values())
        if lost < _LOST:
            return start, end, []
        clocks = f". Are the clocks of {first} and {last} set alike?" if lost > end - start else ""
        return start, end, [f"only the time that all sensors cover is used, from {start:.3f} s to {end:.3f} s{clocks}"]
    # Gaps may overlap: a part begins where all previous gaps have ended.
    overs = np.maximum.accumulate([start, *(over for _, over, _ in gaps)]).tolist()
    parts = zip(overs, [*(begin for begin, _, _ in gaps), end], strict=True)
    start, end = max(parts, key=lambda part: part[1] - part[0])
    spans = list(dict.fromkeys((begin, over) for begin, over, _ in gaps))
    longest = sorted(sorted(spans, key=lambda span: span[0] - span[1])[:_SHOWN])
    more = f" and in {len(spans) - _SHOWN} shorter gaps" if len(spans) > _SHOWN else ""
    names = list(dict.fromkeys(name for _, _, name in gaps))
    whose = f"{', '.join(names)} {'have' if len(names) > 1 else 'has'} no"
    whose = "there are no" if len(names) == len(streams) else whose
    listed = ", ".join(f"from {begin:.3f} s to {over:.3f} s" for begin, over in longest)
    used = f"only the longest part without gaps is used, from {start:.3f} s to {end:.3f} s"
    return start, end, [f"{whose} samples {listed}{more}: {used}"]


def _common_times(streams: Iterable[Stream], start: float, end: float) -> Array | None:
    """The streams' times if all have the same, at equal steps; otherwise None."""
    times = [s.time[(s.time >= start - _SAME * s.step) & (s.time <= end + _SAME * s.step)] for s in streams]
    first = times[0]
    if len(first) < _FEWEST or any(len(time) != len(first) for time in times):
        return None
    step = float((first[-1] - first[0]) / (len(first) - 1))
    regular = first[0] + step * np.arange(len(first))
    return regular if all(np.abs(time - regular).max() <= _SAME * step for time in times) else None


def _merged(time: Array, values: Array, least: float) -> tuple[Array, Array]:
    """Means of samples within less than a time [s]: splines through samples that are too close would swing."""
    if np.diff(time).min() >= least:
        return time, values
    starts = [0]
    for k, at in enumerate(time):
        if at - time[starts[-1]] >= least:
            starts.append(k)
    counts = np.diff([*starts, len(time)])
    return np.add.reduceat(time, starts) / counts, np.add.reduceat(values, starts) / counts[:, None]


def _at(stream: Stream, time: Array, is_pose: bool) -> Array:
    """Values (m, width) at other times (m,) with equal steps."""
    from scipy.interpolate import CubicSpline  # servers write recordings without it

    from coheft.estimation.batch.signals import low_pass, without_jumps

    own, values = stream.time, stream.values
    if is_pose:
        values = without_jumps(values)
    own, values = _merged(own, values, _CLOSE * stream.step)
    step = float((time[-1] - time[0]) / (len(time) - 1))
    if step > _FASTER * stream.step:
        regular = np.arange(own[0], own[-1], stream.step)
        values = low_pass(CubicSpline(own, values)(regular), 1.0 / stream.step, _ALIAS / step)
        own = regular
    found: Array = values if np.array_equal(own, time) else CubicSpline(own, values)(time)
    if is_pose:
        with np.errstate(over="ignore"):
            lengths = np.linalg.norm(found[:, 3:], axis=1, keepdims=True)
        is_unit = np.abs(lengths - 1.0) < 0.01  # the checks refuse the others
        found = np.hstack([found[:, :3], found[:, 3:] / np.where(is_unit, lengths, 1.0)])
    return found
