"""Checks that arms can follow the motions of a scenario.

Millimetres and degrees, where metres and radians are expected, are a common mistake: the server refuses what such
motions ask for, or the robots turn the payload over.
"""

from __future__ import annotations

import numpy as np

from coheft.errors import ScenarioError
from coheft.estimation.geometry.smooth_step import cubic_step, least_jerk_step
from coheft.wire.scenario.reach import MAX_POSITION, MAX_ROTATION, Reach
from coheft.wire.scenario.schema import Scenario
from coheft.wire.scenario.stability import rounded_down

_IN_METRES = "in metres, not millimetres"
_IN_RADIANS = "in radians, not degrees"
_STEPS = np.linspace(0.0, 1.0, 201)
"""Of a smooth step from rest to rest, as shares of its time."""
_LEAST_JERK, _LEAST_JERK_RATE = least_jerk_step(_STEPS)
_CUBIC, _CUBIC_RATE = cubic_step(_STEPS)


def check_motion(scenario: Scenario, origin: str) -> None:
    """Check that no motion exceeds what the server accepts; users' motions are unknown here.

    For a common path, the first robot's motion is checked.

    Raises:
        ScenarioError: A motion does.
    """
    with np.errstate(all="ignore"):  # numbers may be arbitrarily large
        _check_alone(scenario, Reach(scenario.robots), origin)
        _check_carry(scenario, Reach(scenario.robots), origin)


def _check_alone(scenario: Scenario, reach: Reach, origin: str) -> None:
    motion = scenario.motion
    turns, shifts = max(motion.axes[:3]), max(motion.axes[3:])
    if motion.via_points is not None:
        via = motion.via_points
        # Times are scaled so that all robots finish at the same time.
        scale = (sum(via.transit) + sum(via.dwell)) / (2.0 * (via.transit[1] + via.dwell[1]))
        shortest = min(scale * via.transit[0], via.hold_transit)
        gain = shifts * _gain_between_points(reach.position_delay, shortest)
        _check(origin, "motion.translation", motion.translation, gain, MAX_POSITION, "m", _IN_METRES)
    elif motion.own is None:
        highest = motion.frequency[1]
        gain = turns * _gain_of_wave(reach.rotation_delay, highest, motion.ramp)
        _check(origin, "motion.rotation", motion.rotation, gain, MAX_ROTATION, "rad", _IN_RADIANS)
        gain = shifts * _gain_of_wave(reach.position_delay, highest, motion.ramp)
        _check(origin, "motion.translation", motion.translation, gain, MAX_POSITION, "m", _IN_METRES)


def _check_carry(scenario: Scenario, reach: Reach, origin: str) -> None:
    carry = scenario.carry
    if carry is None:
        return
    for amplitude, period in zip(carry.translation, carry.translation_period, strict=True):
        gain = _gain_of_path(reach.position_delay, period, carry.ramp)
        _check(origin, "carry.translation", amplitude, gain, MAX_POSITION, "m", _IN_METRES)
    for amplitude, period in zip(carry.rotation_deg, carry.rotation_period, strict=True):
        gain = _gain_of_path(reach.rotation_delay, period, carry.ramp)
        _check(origin, "carry.rotation_deg", amplitude, gain, np.degrees(MAX_ROTATION), "degrees", "in degrees")


def _gain_of_wave(delay: float, frequency: float, ramp: float) -> float:
    """Return the largest sum of displacement and delayed rate of sinusoids with a smooth start, per amplitude."""
    wave = float(np.hypot(1.0, 2.0 * np.pi * frequency * delay))
    return max(wave, float(np.max(_CUBIC * wave + delay * _CUBIC_RATE / ramp))) if ramp > 0.0 else wave


def _gain_of_path(delay: float, period: float, ramp: float) -> float:
    """Return the largest sum of displacement and delayed rate of a common path."""
    wave = float(np.hypot(1.0, 2.0 * np.pi / period * delay))
    return max(wave, float(np.max(_LEAST_JERK * wave + delay * _LEAST_JERK_RATE / ramp)))


def _gain_between_points(delay: float, shortest: float) -> float:
    """Return the largest sum of displacement and delayed rate of a move across the range in a given time [s]."""
    return float(np.max(np.abs(2.0 * _LEAST_JERK - 1.0) + 2.0 * delay * _LEAST_JERK_RATE / shortest))


def _check(origin: str, key: str, found: float, gain: float, limit: float, unit: str, meant: str) -> None:
    """Check that an amplitude times a factor is within a limit."""
    if found == 0.0 or found * gain <= limit:
        return
    raise ScenarioError(
        f"{origin}: key '{key}': found {found:g}, with which a hand can be asked to go {found * gain:.3g} {unit} from "
        f"its home, its speed counted in; arms go {limit:.3g} {unit} at most: expected at most "
        f"{rounded_down(limit / gain):g}, {meant}"
    )
