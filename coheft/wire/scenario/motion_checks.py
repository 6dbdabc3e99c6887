"""The rule that arms can follow the motions of a scenario.

Millimetres and degrees, where metres and radians are expected, are a common mistake: the server refuses what such
motions ask for, or the robots turn the payload over.
"""

from collections.abc import Iterator

import numpy as np

from coheft.estimation.geometry.smooth_step import cubic_step, least_jerk_step
from coheft.estimation.geometry.spatial import Array
from coheft.wire.scenario.motion import Carry, Motion
from coheft.wire.scenario.reach import MAX_POSITION, MAX_ROTATION, Reach
from coheft.wire.scenario.rules import Complaint, rounded_down
from coheft.wire.scenario.schema import Scenario

_IN_METRES = "in metres, not millimetres"
_IN_RADIANS = "in radians, not degrees"
_STEPS = np.linspace(0.0, 1.0, 201)
"""Of a smooth step from rest to rest, as shares of its time."""
_LEAST_JERK, _CUBIC = least_jerk_step(_STEPS), cubic_step(_STEPS)
"""Steps of a common path and of a robot's sinusoids, with their rates."""


@np.errstate(all="ignore")  # numbers may be arbitrarily large
def motion_complaints(scenario: Scenario) -> list[Complaint]:
    """Complain about motions that exceed what the server accepts; users' motions are unknown here.

    For a common path, the first robot's motion is checked.
    """
    reach = Reach(scenario.robots)
    return [*_alone(scenario.motion, reach), *_together(scenario.carry, reach)]


def _alone(motion: Motion, reach: Reach) -> Iterator[Complaint]:
    turns, shifts = max(motion.axes[:3]), max(motion.axes[3:])
    if motion.via_points is not None:
        via = motion.via_points
        # Times are scaled so that all robots finish at the same time.
        scale = (sum(via.transit) + sum(via.dwell)) / (2.0 * (via.transit[1] + via.dwell[1]))
        shortest = min(scale * via.transit[0], via.hold_transit)
        gain = shifts * _gain_between_points(reach.position_delay, shortest)
        yield from _too_far("motion.translation", motion.translation, gain, MAX_POSITION, "m", _IN_METRES)
    elif motion.own is None:
        highest = motion.frequency[1]
        gain = turns * _gain_of_wave(reach.rotation_delay, highest, motion.ramp)
        yield from _too_far("motion.rotation", motion.rotation, gain, MAX_ROTATION, "rad", _IN_RADIANS)
        gain = shifts * _gain_of_wave(reach.position_delay, highest, motion.ramp)
        yield from _too_far("motion.translation", motion.translation, gain, MAX_POSITION, "m", _IN_METRES)


def _together(carry: Carry | None, reach: Reach) -> Iterator[Complaint]:
    if carry is None:
        return
    for amplitude, period in zip(carry.translation, carry.translation_period, strict=True):
        gain = _gain_of_wave(reach.position_delay, 1.0 / period, carry.ramp, _LEAST_JERK)
        yield from _too_far("carry.translation", amplitude, gain, MAX_POSITION, "m", _IN_METRES)
    for amplitude, period in zip(carry.rotation_deg, carry.rotation_period, strict=True):
        gain = _gain_of_wave(reach.rotation_delay, 1.0 / period, carry.ramp, _LEAST_JERK)
        yield from _too_far("carry.rotation_deg", amplitude, gain, np.degrees(MAX_ROTATION), "degrees", "in degrees")


def _gain_of_wave(delay: float, frequency: float, ramp: float, start: tuple[Array, Array] = _CUBIC) -> float:
    """Return the largest sum of displacement and delayed rate of sinusoids with a smooth start, per amplitude."""
    wave, (share, rate) = float(np.hypot(1.0, 2.0 * np.pi * frequency * delay)), start
    return max(wave, float(np.max(share * wave + delay * rate / ramp))) if ramp > 0.0 else wave


def _gain_between_points(delay: float, shortest: float) -> float:
    """Return the largest sum of displacement and delayed rate of a move across the range in a given time [s]."""
    share, rate = _LEAST_JERK
    return float(np.max(np.abs(2.0 * share - 1.0) + 2.0 * delay * rate / shortest))


def _too_far(key: str, found: float, gain: float, limit: float, unit: str, meant: str) -> Iterator[Complaint]:
    """Complain if an amplitude times a factor is beyond a limit."""
    if not (found == 0.0 or found * gain <= limit):
        yield (
            key,
            f"found {found:g}, which moves a hand up to {found * gain:.3g} {unit} from its home, its speed "
            f"included; arms reach {limit:.3g} {unit}: expected at most {rounded_down(limit / gain):g}, {meant}",
        )
