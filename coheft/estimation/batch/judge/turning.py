"""Whether all robots turn equally fast at the same times: robots that hold one load do, whatever their frames.

A clock that is off by much more than the motion's time scale makes grasp poses unobservable, or wrong, and then nothing
else shows it.
"""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

from coheft.estimation.batch.judge.evidence import Evidence, level_of
from coheft.estimation.batch.judge.verdict import Cause, Verdict
from coheft.estimation.batch.recording import CHANNELS
from coheft.estimation.geometry.body_motion import BODY_W
from coheft.estimation.geometry.spatial import Array

_ALIKE, _UNLIKE = 0.9, 0.6
"""Correlations of angular speeds above which they are those of one load, and below which they are not."""
_LONGEST = 10.0
"""Largest difference between clocks that is looked for [s]; at most a third of the recording."""
_FINEST = 1e-4
"""Resolution of a delay [s]."""
_NEAR, _AS_GOOD = 0.1, 0.01
"""Correlations at other delays that are less by this are looked at more closely, and are then as good as the best."""
_MOST_NAMED = 3
"""Delays that are named if a motion repeats itself."""
_NOISY = 0.5
"""Noise of a robot's angular speeds, relative to the change of the others', that may be why they do not correlate."""


def judge_turning(evidence: Evidence) -> Verdict | None:
    """Find a robot that turns as all others do, but at other times, or, if poses are not seen, otherwise; else None."""
    speeds = np.linalg.norm(evidence.signals.motion[..., BODY_W], axis=-1)
    if np.ptp(speeds, axis=1).min() == 0.0:
        return None
    alike, robots = np.corrcoef(speeds), np.arange(len(speeds))
    for robot in robots[::-1]:
        rest = np.delete(robots, robot)
        other = speeds[rest].mean(axis=0)
        as_recorded = float(np.corrcoef(speeds[robot], other)[0, 1])
        if alike[np.ix_(rest, rest)].min() < _ALIKE or as_recorded > _UNLIKE:
            continue
        delays, shifted = _delays(evidence.signals.time, speeds[robot], other)
        if shifted > _ALIKE:
            return _late(evidence, robot, delays, as_recorded, shifted)
        if len(rest) > 1 and not evidence.is_seen and _noise(evidence, robot) < _NOISY * other.std():
            words = (
                f"{evidence.recording.names[robot]} does not turn as the others do: its angular speeds correlate with "
                f"theirs by {as_recorded:.2g}, and by {shifted:.2g} at most if its clock is set otherwise. Are times "
                f"those of its samples, with none left out, and does it hold the same load?"
            )
            return Verdict(Cause.UNKNOWN, words=words)
    return None


def _noise(evidence: Evidence, robot: int) -> float:
    """Standard deviation of the noise of a robot's filtered angular velocity, about one axis [rad/s]."""
    recording, cutoff = evidence.recording, evidence.cutoff
    share = 2.0 * cutoff / recording.rate  # of white noise, in the band of the filter
    if recording.has("twist"):
        return float(np.sqrt(share * np.mean(level_of(evidence, robot, "twist")[:3] ** 2)))
    return float(2.0 * np.pi * cutoff * np.sqrt(share / 3.0) * level_of(evidence, robot, "pose")[0])


def _late(evidence: Evidence, robot: int, delays: Sequence[float], as_recorded: float, shifted: float) -> Verdict:
    recording, culprit = evidence.recording, evidence.culprit(robot)
    what = "twists" if recording.has("twist") else "poses"
    either = "" if culprit else " (or those of the other robot, the other way round)"
    more = ", …" if len(delays) > _MOST_NAMED else ""
    rivals = f" (or {', '.join(map(_in_words, delays[1:_MOST_NAMED]))}{more}: the motion repeats itself)"
    size = _in_words(delays[0]) + (rivals if len(delays) > 1 else "")
    words = (
        f"{what} of {recording.names[robot]} are{either} {size} against the others': as recorded, its angular "
        f"speeds correlate with theirs by {as_recorded:.2g}, without this by {shifted:.2g}. Perhaps its other "
        f"measurements are, too: shift its samples in time"
    )
    channels = tuple(channel for channel in CHANNELS if recording.has(channel))
    is_open = culprit is None or len(delays) > 1
    return Verdict(Cause.CLOCK, culprit, (delays[0],), words, is_open=is_open, channels=channels)


def _in_words(delay: float) -> str:
    thousandths = abs(1e3 * delay)
    size = f"{abs(delay):.4g} s" if round(thousandths) >= 1000 else f"{thousandths:.3g} ms"
    return f"{size} {'late' if delay > 0.0 else 'early'}"


def _delays(time: Array, late: Array, other: Array) -> tuple[list[float], float]:
    """Return the delays with which one robot's angular speeds (n,) correlate best with others', and this correlation.

    If the motion repeats itself, several do equally well; the shortest comes first.
    """
    longest = min(_LONGEST, (time[-1] - time[0]) / 3.0)
    at = _correlation(time, late, other)
    step = float(time[1] - time[0])
    count = int(longest / step)
    tried = step * np.arange(-count, count + 1)
    rough = np.array([at(delay) for delay in tried])
    beside = np.pad(rough, 1, constant_values=-np.inf)
    is_peak = (rough >= beside[:-2]) & (rough >= beside[2:]) & (rough > rough.max() - _NEAR)
    found = [
        minimize_scalar(lambda delay: -at(delay), bounds=(peak - step, peak + step), options={"xatol": _FINEST})
        for peak in tried[is_peak]
    ]
    best = max(-float(peak.fun) for peak in found)
    return sorted((float(peak.x) for peak in found if -peak.fun > best - _AS_GOOD), key=abs), best


def _correlation(time: Array, late: Array, other: Array) -> Callable[[float], float]:
    """Return the correlation of angular speeds as a function of the delay [s]."""
    spline = CubicSpline(time, other)

    def at(delay: float) -> float:
        inside = (time - delay >= time[0]) & (time - delay <= time[-1])
        return float(np.corrcoef(late[inside], spline(time[inside] - delay))[0, 1])

    return at
