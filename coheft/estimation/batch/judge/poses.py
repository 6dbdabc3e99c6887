"""Whether all robots' poses are those of one load at the same times; if not, which robot's are wrong."""

import numpy as np

from coheft.estimation.batch.judge.clocks import clock_delays
from coheft.estimation.batch.judge.evidence import Evidence
from coheft.estimation.batch.judge.slips import find_slip
from coheft.estimation.batch.judge.verdict import Cause, Verdict
from coheft.estimation.batch.judge.views import Views
from coheft.estimation.batch.recording import CHANNELS

_SURE = 6.0
"""Standard deviations beyond which a difference is no chance."""
_STRETCHED = 5e-4
"""Relative difference of lengths that does not matter."""
_CALIBRATED = 0.2
"""Largest relative error of lengths that may be one of several calibration errors."""
_MOST = 0.9
"""Share of large differences that a wrong scale has to explain."""
_FINEST = 1e-6
"""Effect on poses that no sensor resolves, but rounding may have [m]."""
_LATE = 1e-3
"""Difference of clocks that does not matter [s]."""


def judge_poses(evidence: Evidence) -> Verdict | None:
    """Find a clock that is late, a grasp that slipped, or a wrong scale of lengths; None if there is none."""
    late = _late(evidence)
    if late is not None or not evidence.homes:
        return late
    views = Views.of(evidence)
    return find_slip(evidence, views) or _stretched(evidence, views)


def _late(evidence: Evidence) -> Verdict | None:
    """Find a robot whose clock is not that of the others."""
    recording = evidence.recording
    delays, deviations = clock_delays(evidence.signals, evidence.poses)
    sure = np.where(np.abs(delays) > np.maximum(_SURE * deviations, _LATE), np.abs(delays), 0.0)
    if not sure.any():
        return None
    worst = int(np.argmax(sure))
    delay, std, culprit = float(delays[worst]), float(deviations[worst]), evidence.culprit(worst)
    what = "twists" if recording.has("twist") else "poses"
    either = "" if culprit else " (or those of the other robot, the other way round)"
    return Verdict(
        Cause.CLOCK,
        culprit,
        (delay,),
        f"{what} of {recording.names[worst]} are{either} {abs(1e3 * delay):.3g} ms "
        f"{'late' if delay > 0.0 else 'early'} against the others' (std {1e3 * std:.2g} ms), and perhaps its other "
        f"measurements, too: shift its samples in time",
        is_open=culprit is None,
        channels=tuple(channel for channel in CHANNELS if recording.has(channel)),
    )


def _stretched(evidence: Evidence, views: Views) -> Verdict | None:
    """Find a robot whose positions are too large or too small by a factor; a calibration estimates this along."""
    if evidence.tolerances is not None:
        return None
    names, (count, batches) = evidence.recording.names, views.rest.shape[:2]
    gains, factors, deviations = np.empty((3, count))
    columns = np.empty((count, batches, 6))
    for robot, positions in enumerate(views.positions):
        column = np.hstack([np.zeros((batches, 3)), positions]) * views.scale
        columns[robot] = column = column - views.basis @ np.einsum("biq,bi->q", views.basis, column)
        size = float(np.sum(column**2))
        own = views.rest[robot] * count / (count - 1)
        excess = float(np.sum(column * own)) / size
        left = own - excess * column
        square = np.sum(left**2)
        # The residuals of a compliant grip are correlated.
        correlation = float(np.clip(np.sum(left[1:] * left[:-1]) / square, 0.0, 0.95))
        variance = square / left.size * (1.0 + correlation) / (1.0 - correlation) / size
        gains[robot], factors[robot], deviations[robot] = excess**2 * size, 1.0 + excess, np.sqrt(variance)
    worst = int(np.argmax(gains))
    factor, std, culprit = float(factors[worst]), float(deviations[worst]), evidence.culprit(worst)
    effect = abs(factor - 1.0) * np.sqrt(np.mean((columns[worst] / views.scale) ** 2))
    if abs(factor - 1.0) < max(_SURE * std, _STRETCHED) or effect < _FINEST:
        return None
    is_large = bool(evidence.suspicions) or abs(factor - 1.0) > _CALIBRATED
    if is_large and gains[worst] * count / (count - 1) < _MOST * np.sum(views.rest**2):
        return None  # something else is wrong, which lengths explain a part of
    other = "" if culprit else f", or those of {names[1 - worst]} {1.0 / factor:.4g} times"
    return Verdict(
        Cause.LENGTH_SCALE,
        culprit,
        (factor,),
        f"positions of {names[worst]} are {factor:.4g} times what they should be by the others' (std {std:.2g}){other}"
        f": another unit, or calibration (--calibrate)",
        is_open=culprit is None,
    )
