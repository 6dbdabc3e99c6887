"""Whether all robots' poses are those of one load at the same instants, and if not, whose are not."""

from __future__ import annotations

import numpy as np

from coheft.estimation.batch.judge.cause import Cause
from coheft.estimation.batch.judge.clocks import clock_delays
from coheft.estimation.batch.judge.evidence import Evidence
from coheft.estimation.batch.judge.slips import find_slip
from coheft.estimation.batch.judge.verdict import Verdict

_SURE = 6.0
_LATE = 1e-3
"""Clocks that differ by less hardly matter [s]."""


def judge_poses(evidence: Evidence) -> Verdict | None:
    """Judge whether robots' motions are of the same instants, and grasps where they were all the time.

    Returns:
        None if nothing speaks against it.
    """
    return _late(evidence) or (_slipped(evidence) if evidence.homes else None)


def _slipped(evidence: Evidence) -> Verdict | None:
    """A grasp that is elsewhere in the load from some time on."""
    recording, poses = evidence.recording, evidence.poses
    slip = find_slip(recording.stacked("pose"), recording.time, evidence.homes, poses)
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
        channels=channels,
        words=f"{what} of {whose} {abs(1e3 * delay):.3g} ms {'late' if delay > 0.0 else 'early'} against the others' "
        f"(std {1e3 * std:.2g} ms), and perhaps all else that is recorded of it: shift its samples in time",
    )
