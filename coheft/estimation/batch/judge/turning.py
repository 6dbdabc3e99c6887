"""Whether all robots turn equally fast at the same times: robots that hold one load do, whatever their frames.

A clock that is off by much more than the motion's time scale makes grasp poses unobservable, or wrong, and then nothing
else shows it.
"""

from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

from coheft.estimation.batch.judge.evidence import Evidence
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
        delay, shifted = _delay(evidence.signals.time, speeds[robot], other)
        if shifted > _ALIKE:
            return _late(evidence, robot, delay, as_recorded, shifted)
        if len(rest) > 1 and not evidence.is_seen:  # the others show that this is not noise
            words = (
                f"{evidence.recording.names[robot]} does not turn as the others do: its angular speeds correlate with "
                f"theirs by {as_recorded:.2g}, and by {shifted:.2g} at most if its clock is set otherwise. Are times "
                f"those of its samples, with none left out, and does it hold the same load?"
            )
            return Verdict(Cause.UNKNOWN, words=words)
    return None


def _late(evidence: Evidence, robot: int, delay: float, as_recorded: float, shifted: float) -> Verdict:
    recording, culprit = evidence.recording, evidence.culprit(robot)
    what = "twists" if recording.has("twist") else "poses"
    either = "" if culprit else " (or those of the other robot, the other way round)"
    size = f"{abs(delay):.4g} s" if abs(delay) >= 1.0 else f"{abs(1e3 * delay):.3g} ms"
    words = (
        f"{what} of {recording.names[robot]} are{either} {size} {'late' if delay > 0.0 else 'early'} against the "
        f"others': as recorded, its angular speeds correlate with theirs by {as_recorded:.2g}, without this by "
        f"{shifted:.2g}. Perhaps its other measurements are, too: shift its samples in time"
    )
    channels = tuple(channel for channel in CHANNELS if recording.has(channel))
    return Verdict(Cause.CLOCK, culprit, (delay,), words, is_open=culprit is None, channels=channels)


def _delay(time: Array, late: Array, other: Array) -> tuple[float, float]:
    """Return the delay with which one robot's angular speeds (n,) best correlate with others', and this correlation."""
    longest = min(_LONGEST, (time[-1] - time[0]) / 3.0)
    at = _correlation(time, late, other)
    step = float(time[1] - time[0])
    count = int(longest / step)
    rough = max((step * k for k in range(-count, count + 1)), key=at)
    found = minimize_scalar(lambda delay: -at(delay), bounds=(rough - step, rough + step), options={"xatol": _FINEST})
    return float(found.x), float(-found.fun)


def _correlation(time: Array, late: Array, other: Array) -> Callable[[float], float]:
    """Return the correlation of angular speeds as a function of the delay [s]."""
    spline = CubicSpline(time, other)

    def at(delay: float) -> float:
        inside = (time - delay >= time[0]) & (time - delay <= time[-1])
        return float(np.corrcoef(late[inside], spline(time[inside] - delay))[0, 1])

    return at
