"""Grasps that slipped in a run, and when the robots noticed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import msgspec
import numpy as np

from coheft.app.results.judge import Judge
from coheft.estimation.geometry.spatial import Pose, rotation_log
from coheft.wire.messages.structs import Estimate
from coheft.wire.messages.truth import Truth

_ROUNDING = 1e-9


class SlipReport(msgspec.Struct, frozen=True):
    """A grasp that slipped.

    Attributes:
        at_s: Time of the slip [s].
        robot: The robot whose grasp slipped.
        translation_mm: Displacement of its frame [mm].
        rotation_deg: Rotation of its frame [degrees].
        named_at_s: When the last robot had identified this slip [s]; None if some never did.
    """

    at_s: float
    robot: str
    translation_mm: float
    rotation_deg: float
    named_at_s: float | None


@dataclass(frozen=True, eq=False)
class _Slip:
    at: float
    robot: str
    moved: Pose


class SlipRecord:
    """Collects slips from the truth, and when robots identified them."""

    def __init__(self, judge: Judge) -> None:
        self._judge, self._slips = judge, list[_Slip]()
        self._known = dict[str, Pose]()

    def follow(self, truth: Truth) -> None:
        """Note grasps that have changed in this block; to be called before the truth is added to the judge."""
        for robot, grasp in truth.slipped.items():
            now = Pose(grasp.rotation, grasp.translation)
            before = self._known.get(robot) or self._judge.pose_payload_in(robot, truth.block - 1).inverse()
            moved = before.inverse() @ now
            if np.abs(moved.translation).max() > _ROUNDING or np.abs(rotation_log(moved.rotation)).max() > _ROUNDING:
                self._slips.append(_Slip(truth.time * truth.block / (truth.block + 1), robot, moved))
            self._known[robot] = now

    def reports(self, latest: Iterable[Estimate]) -> list[SlipReport]:
        """Return all slips in order of time, with the times from the robots' newest estimates."""
        estimates = list(latest)
        return [self._report(slip, estimates) for slip in self._slips]

    def _report(self, slip: _Slip, estimates: list[Estimate]) -> SlipReport:
        next_one = min(
            (each.at for each in self._slips if each.robot == slip.robot and each.at > slip.at), default=np.inf
        )
        named = [
            [
                each.named_at
                for each in estimate.slips
                if each.robot == slip.robot and slip.at < each.named_at <= next_one
            ]
            for estimate in estimates
        ]
        return SlipReport(
            at_s=round(slip.at, 9),
            robot=slip.robot,
            translation_mm=1e3 * float(np.linalg.norm(slip.moved.translation)),
            rotation_deg=float(np.degrees(np.linalg.norm(rotation_log(slip.moved.rotation)))),
            named_at_s=max(map(min, named)) if named and all(named) else None,
        )
