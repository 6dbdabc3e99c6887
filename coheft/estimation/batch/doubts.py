"""Contradictions in an identification: no robots and no load can be like that, so the recording is wrong somehow."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coheft.estimation.batch.payload import Payload
from coheft.estimation.batch.team_poses import TeamPoses
from coheft.estimation.rigid_body.unseen import middle_and_size

_FAR = 10.0
"""Standard deviations from all bodies that can exist, from which on noise is no explanation."""
_FARTHEST = 20.0
"""No load is longer [m]: a unit will be another one, as with the boxes of scenarios."""
_METRES = "Are all lengths in metres, moments in N·m, and angular velocities in rad/s?"


def unsettled(team: TeamPoses, is_settled: bool) -> tuple[str, ...]:
    """That a fit of poses was broken off, in words; nothing if it was not, or if it had no poses to settle at.

    Args:
        team: What was fitted; what is not seen of it need not settle.
        is_settled: Whether steps had become small.
    """
    if is_settled or any(team.relative(0, k).unseen for k in range(1, len(team.poses))):
        return ()
    return (
        "Poses were still changing when their fit was broken off. Are poses and twists those of grasp frames, and do "
        "all clocks agree? Did a robot let go (--from and --to choose a part)?",
    )


def doubts_about(names: Sequence[str], team: TeamPoses, payload: Payload) -> tuple[str, ...]:
    """What cannot be, in words, of what was seen.

    Args:
        names: Of the robots.
        team: Their grasps.
        payload: What they hold.
    """
    doubts = []
    relative = [team.relative(0, k) for k in range(1, len(names))]
    far = {
        name: distance
        for name, pose in zip(names[1:], relative, strict=True)
        if not pose.unseen and (distance := float(np.linalg.norm(pose.pose.translation))) > _FARTHEST
    }
    if far:
        told = ", ".join(f"{name} {distance:.0f} m" for name, distance in far.items())
        doubts.append(f"One load would be held by robots too far from {names[0]}: {told}. {_METRES}")
    middle, _ = middle_and_size(team.poses)
    away = float(np.linalg.norm(payload.inertia.com - middle))
    if away > _FARTHEST and payload.is_seen("com") and not far:
        doubts.append(f"The centre of mass would be {away:.0f} m from where robots hold the load. {_METRES}")
    if payload.deviations_off > _FAR:
        doubts.append(
            f"The mass properties are physically impossible, by {payload.deviations_off:.0f} of their standard "
            f"deviations. Are forces and moments those on the load, in the axes of the grasp frame, and do all clocks "
            f"agree? "
            f"Did the load change (--from and --to choose a part)? Are the robots badly calibrated (--method pose "
            f"--calibrate, which needs poses)?"
        )
    return tuple(doubts)
