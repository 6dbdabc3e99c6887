"""Export of a load in the frame and format of the target, for the command and for Python."""

from __future__ import annotations

from typing import Literal

import msgspec

from coheft.app.export.formats import export_load
from coheft.app.export.found_load import FoundLoad
from coheft.app.export.verdict import Answer, Limits, judge_load
from coheft.errors import UsageError
from coheft.wire.scenario.section import pose_of

Target = Literal["urdf", "mjcf", "franka", "ur", "kuka", "verdict"]
Placement = tuple[float, float, float, float, float, float]
"""Pose of the grasp frame in the frame of the flange: position [m], rotation vector [degrees]."""


def hand_over(load: FoundLoad, target: Target, flange: Placement | None, limits: Limits) -> tuple[str, Answer]:
    """Return the text for the target, and whether the load is within the limits.

    Args:
        load: The load in the grasp frame of the robot that identified it.
        target: The target.
        flange: Pose of that frame in the frame of the flange; None if they coincide.
        limits: Limits for a verdict.

    Raises:
        UsageError: There are limits, but the target is not a verdict.
        CoheftError: The target does not accept such a load.
    """
    if target != "verdict" and limits != Limits():
        raise UsageError("limits of mass, offset and inertia are for a verdict: add --as verdict, or leave them out")
    frame = f"grasp frame of {load.robot}, which is taken for that of the flange"
    if flange is not None:
        load = load.seen_from(pose_of(flange[:3], flange[3:]))
        frame = f"flange, with the grasp frame of {load.robot} at {' '.join(f'{x:g}' for x in flange)} (m, degrees)"
    if target == "verdict":
        verdict = judge_load(load, limits, frame)
        return msgspec.json.format(msgspec.json.encode(verdict)).decode() + "\n", verdict.answer
    return export_load(load, target, frame), "within"
