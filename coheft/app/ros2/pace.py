"""The pace of measurements by their stamps and by their arrival, and what is wrong with it.

Arrival times are those of our own clock. Stamps may be of any clock; recordings and simulations may run faster or
slower than that, and pause.
"""

from collections import deque
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from coheft.estimation.geometry.spatial import Array

_KEPT, _FEWEST = 600, 40
"""Number of newest measurements that are kept, and the least number that tells the pace."""
_PAUSE = 1.0
"""Longer times between arrivals are pauses [s]."""
_OTHER_UNIT = 50.0
"""Ratio of stamps' time and passed time, or its inverse, that no simulation or recording has."""
_EQUAL, _BUNCHED = 0.3, 0.1
_SLOW, _FAST = 0.97, 1.3
_SCATTER = 0.25
"""Deviation of stamps from regular times, in samples, with which many are nearer to another sample's time."""
_APART, _SURE = 0.015, 4.0
"""Difference between stamps of measurements that arrive together [s], and in deviations, that is worth a word."""


class Fault(NamedTuple):
    """What is wrong with a pace: its kind, and a sentence without subject."""

    kind: str
    words: str


class Pace:
    """The pace of one stream of measurements."""

    def __init__(self) -> None:
        self._times: deque[tuple[int, int]] = deque(maxlen=_KEPT)

    def note(self, stamp: int, arrival: int) -> None:
        """Note a measurement: its stamp [ns], and its arrival [ns]."""
        self._times.append((stamp, arrival))

    @property
    def is_known(self) -> bool:
        """Whether enough measurements have arrived."""
        return len(self._times) >= _FEWEST

    def fault(self, rate: float) -> Fault | None:
        """Compare stamps with regular times at a rate [1/s]; None if nothing is wrong, or too few have arrived."""
        if not self.is_known:
            return None
        stamps, passed = self._seconds()
        steps, period = np.diff(stamps), 1.0 / rate
        span = float(stamps[-1] - stamps[0])
        if not steps.any():
            return Fault("still", "stamps stand still: expected the time of each measurement")
        if not 1.0 / _OTHER_UNIT < span / max(passed, 1e-9) < _OTHER_UNIT:
            return Fault("unit", f"stamps advance by {span:.3g} s while {passed:.3g} s pass: in another unit?")
        forward = steps[steps > 0.0]
        if np.mean(steps == 0.0) > _EQUAL:
            return Fault("equal", "many stamps are equal to the one before: do they have nanoseconds?")
        step, mean = float(np.median(forward)), span / len(steps)
        if step < _BUNCHED * mean:
            return Fault(
                "bunched", f"stamps are bunched, {step:.2g} s apart with gaps of {steps.max():.2g} s: is nanosec in ns?"
            )
        if mean > period / _SLOW:
            if abs(step - period) < abs(step - mean):
                return Fault(
                    "lost", f"{100.0 * (1.0 - period / mean):.2g} % are missing by their stamps: lost on the way?"
                )
            return Fault("slow", f"{1.0 / mean:.4g} a second by their stamps, expected sensors.rate, {rate:g}")
        if mean < period / _FAST:
            return Fault(
                "fast",
                f"{1.0 / mean:.4g} a second by their stamps, of which {rate:g} (sensors.rate) are used, unfiltered",
            )
        regular = np.polynomial.Polynomial.fit(np.arange(len(stamps)), stamps, 1)(np.arange(len(stamps)))
        scatter = float(np.std(stamps - regular))
        if scatter > _SCATTER * period:
            return Fault(
                "scattered",
                f"stamps are off regular times by {1e3 * scatter:.3g} ms (standard deviation), expected much less than "
                f"half a sample, {500.0 * period:.3g} ms",
            )
        return None

    def lead(self) -> tuple[float, float] | None:
        """How far stamps are ahead of our own clock [s], and the deviation; None if they do not keep pace with it."""
        if not self.is_known:
            return None
        stamps, passed = self._seconds()
        if not 0.5 < float(stamps[-1] - stamps[0]) / max(passed, 1e-9) < 2.0:
            return None
        leads = np.array([stamp - arrival for stamp, arrival in self._times]) / 1e9
        middle = float(np.median(leads))
        return middle, float(np.median(np.abs(leads - middle)))

    def _seconds(self) -> tuple[Array, float]:
        """Stamps since the first one, and the time that has passed without pauses [s]."""
        times = np.array(self._times, dtype=np.int64)
        arrivals = np.diff(times[:, 1]) / 1e9
        stamps: Array = (times[:, 0] - times[0, 0]) / 1e9
        return stamps, float(np.sum(np.minimum(arrivals, _PAUSE)))


def words_of(paces: Mapping[str, Mapping[str, Pace]], rate: Mapping[str, float]) -> dict[tuple[str, ...], str]:
    """Describe what is wrong with paces by robot and stream, at rates by robot [1/s]; by what the words are about."""
    found: dict[tuple[str, ...], str] = {}
    for robot, own in paces.items():
        faults = {stream: fault for stream, pace in own.items() if (fault := pace.fault(rate[robot])) is not None}
        for kind in dict.fromkeys(fault.kind for fault in faults.values()):
            same = [stream for stream, fault in faults.items() if fault.kind == kind]
            topics = ", ".join(f"/{robot}/{stream}" for stream in same)
            found[robot, kind] = f"{topics}: {faults[same[0]].words}"
        found |= _apart({f"/{robot}/{stream}": lead for stream, pace in own.items() if (lead := pace.lead())})
    first = {robot: next(iter(own.values())).lead() for robot, own in paces.items()}
    return found | _apart({robot: lead for robot, lead in first.items() if lead})


def _apart(leads: Mapping[str, tuple[float, float]]) -> dict[tuple[str, ...], str]:
    """Find what has stamps that differ from those of others that arrive at the same time."""
    names = sorted(leads, key=lambda name: leads[name][0])
    if len(names) == 0:
        return {}
    middle = names[len(names) // 2]
    name = max(names, key=lambda name: abs(leads[name][0] - leads[middle][0]))
    ahead = leads[name][0] - leads[middle][0]
    if abs(ahead) < max(_APART, _SURE * (leads[name][1] + leads[middle][1])):
        return {}
    size = f"{abs(ahead):.3g} s" if abs(ahead) >= 1.0 else f"{1e3 * abs(ahead):.3g} ms"
    what = f"{size} {'ahead of' if ahead > 0.0 else 'behind'} those of {middle}"
    words = f"stamps of {name} are {what} that arrive at the same time: set the clocks alike (PTP), unless the network"
    return {(name, "apart"): f"{words} makes this difference"}
