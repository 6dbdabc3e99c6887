"""Grasps that slipped in a run, and when the robots said so."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import msgspec
import numpy as np

from coheft.app.results.judge import Judge
from coheft.estimation.geometry.spatial import Pose, rotation_log
from coheft.wire.messages.structs import Estimate, Truth

_ROUNDING = 1e-9


class SlipReport(msgspec.Struct, frozen=True):
    """A grasp that slipped.

    Attributes:
        at_s: When it did [s].
        robot: Whose.
        translation_mm: How far its frame moved [mm].
        rotation_deg: How far it turned [degrees].
        named_at_s: When the last robot had found that this grasp slipped [s]; None if some never did.
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
    """Follows the truth."""

    def __init__(self, judge: Judge) -> None:
        self._judge, self._slips = judge, list[_Slip]()
        self._known = dict[str, Pose]()

    def follow(self, truth: Truth) -> None:
        """Note grasps that are elsewhere since this block; the judge must not know it yet."""
        for robot, grasp in truth.slipped.items():
            now = Pose(grasp.rotation, grasp.translation)
            before = self._known.get(robot) or self._judge.pose_payload_in(robot, truth.block - 1).inverse()
            moved = before.inverse() @ now
            if np.abs(moved.translation).max() > _ROUNDING or np.abs(rotation_log(moved.rotation)).max() > _ROUNDING:
                self._slips.append(_Slip(truth.time * truth.block / (truth.block + 1), robot, moved))
            self._known[robot] = now

    def reports(self, latest: Iterable[Estimate]) -> list[SlipReport]:
        """All slips, in order of time, with what the robots' newest estimates say of them."""
        estimates = list(latest)
        return [self._report(slip, estimates) for slip in self._slips]

    def _report(self, slip: _Slip, estimates: list[Estimate]) -> SlipReport:
        until = min((each.at for each in self._slips if each.robot == slip.robot and each.at > slip.at), default=np.inf)
        named = [
            min(
                (each.named_at for each in estimate.slips if _is_of(each.robot, each.named_at, slip, until)),
                default=None,
            )
            for estimate in estimates
        ]
        known = [moment for moment in named if moment is not None]
        return SlipReport(
            at_s=round(slip.at, 9),
            robot=slip.robot,
            translation_mm=1e3 * float(np.linalg.norm(slip.moved.translation)),
            rotation_deg=float(np.degrees(np.linalg.norm(rotation_log(slip.moved.rotation)))),
            named_at_s=max(known) if known and len(known) == len(named) else None,
        )


def _is_of(robot: str, named_at: float, slip: _Slip, until: float) -> bool:
    return robot == slip.robot and slip.at < named_at <= until
