"""Whether all robots' poses are those of one load at the same instants, and if not, whose are not."""

from __future__ import annotations

import numpy as np

from coheft.estimation.batch.judge.cause import Cause
from coheft.estimation.batch.judge.clocks import clock_delays
from coheft.estimation.batch.judge.evidence import Evidence
from coheft.estimation.batch.judge.lengths import find_length_scale
from coheft.estimation.batch.judge.slips import find_slip
from coheft.estimation.batch.judge.verdict import Verdict
from coheft.estimation.batch.judge.views import Views

_SURE = 6.0
_STRETCHED = 5e-4
"""Lengths that differ by a smaller share hardly matter."""
_LATE = 1e-3
"""Clocks that differ by less hardly matter [s]."""


def judge_poses(evidence: Evidence) -> Verdict | None:
    """Judge whether robots' motions are of the same instants, and grasps where they were all the time.

    Returns:
        None if nothing speaks against it.
    """
    late = _late(evidence)
    if late is not None or not evidence.homes:
        return late
    recording = evidence.recording
    views = Views.of(recording.stacked("pose"), recording.time, evidence.homes, evidence.poses)
    return _slipped(evidence, views) or _stretched(evidence, views)


def _stretched(evidence: Evidence, views: Views) -> Verdict | None:
    """A robot whose lengths are not those of the others; a calibration has estimated them along."""
    found, names = find_length_scale(views), evidence.recording.names
    sure = max(_SURE * found.std, _STRETCHED)
    if evidence.tolerances is not None or abs(found.factor - 1.0) < sure:
        return None
    name = names[found.robot] if len(names) > 2 else None
    other = "" if name else f", or those of {names[1 - found.robot]} {1.0 / found.factor:.4g} times"
    return Verdict(
        is_refuted=True,
        cause=Cause.LENGTH_SCALE,
        robot=name,
        value=(found.factor,),
        is_open=name is None,
        words=f"positions of {names[found.robot]} are {found.factor:.4g} times what they should be by the others' "
        f"(std {found.std:.2g}){other}: another unit, or calibration (--calibrate)",
    )


def _slipped(evidence: Evidence, views: Views) -> Verdict | None:
    """A grasp that is elsewhere in the load from some time on."""
    recording, poses = evidence.recording, evidence.poses
    slip = find_slip(views, poses)
    if slip is None:
        return None
    name = recording.names[slip.robot] if len(poses) > 2 else None
    whose = name or f"{recording.names[slip.robot]} (or of the other robot)"
    return Verdict(
        is_refuted=True,
        cause=Cause.SLIP,
        robot=name,
        value=(slip.turn_deg, slip.shift, slip.time),
        words=f"the grasp of {whose} slipped at {slip.time:.1f} s, by {1e3 * slip.shift:.3g} mm and "
        f"{slip.turn_deg:.2g} degrees, or its home moved: --from and --to choose a part",
    )


def _late(evidence: Evidence) -> Verdict | None:
    """A robot whose clock is not that of the others."""
    recording = evidence.recording
    delays, deviations = clock_delays(evidence.signals, evidence.poses)
    sure = np.where(np.abs(delays) > np.maximum(_SURE * deviations, _LATE), np.abs(delays), 0.0)
    if not sure.any():
        return None
    worst = int(np.argmax(sure))
    delay, std = float(delays[worst]), float(deviations[worst])
    name = recording.names[worst] if len(delays) > 2 else None
    channels = tuple(c for c in ("pose", "twist", "dtwist", "acceleration", "wrench") if recording.has(c))
    what = "twists" if recording.has("twist") else "poses"
    whose = (
        f"{name} are" if name else f"{recording.names[worst]} are (or those of the other robot, the other way round)"
    )
    return Verdict(
        is_refuted=True,
        cause=Cause.CLOCK,
        robot=name,
        value=(delay,),
        is_open=name is None,
        channels=channels,
        words=f"{what} of {whose} {abs(1e3 * delay):.3g} ms {'late' if delay > 0.0 else 'early'} against the others' "
        f"(std {1e3 * std:.2g} ms), and perhaps all else that is recorded of it: shift its samples in time",
    )
