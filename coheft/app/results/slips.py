"""Grasps that slipped in a run, and when the robots noticed."""

from collections.abc import Iterable, Sequence

import msgspec
import numpy as np

from coheft.app.results.judge import Judge
from coheft.estimation.geometry.spatial import Pose, rotation_log
from coheft.wire.messages.structs import Estimate, SlipNotice
from coheft.wire.messages.truth import Truth

_ROUNDING = 1e-9


class SlipReport(msgspec.Struct, frozen=True):
    """A grasp that slipped; ``named_at_s`` is when the last robot had identified this slip, None if some never did."""

    at_s: float
    robot: str
    translation_mm: float
    rotation_deg: float
    named_at_s: float | None


class SlipRecord:
    """Collects slips from the truth, and when robots identified them."""

    def __init__(self, judge: Judge) -> None:
        self._judge = judge
        self._slips: list[SlipReport] = []
        self._known: dict[str, Pose] = {}

    def follow(self, truth: Truth) -> None:
        """Note grasps that have changed in this block; to be called before the truth is added to the judge."""
        for robot, grasp in truth.slipped.items():
            now = Pose(grasp.rotation, grasp.translation)
            before = self._known.get(robot) or self._judge.pose_payload_in(robot, truth.block - 1).inverse()
            moved = before.inverse() @ now
            distance, angle = np.linalg.norm(moved.translation), np.linalg.norm(rotation_log(moved.rotation))
            if max(distance, angle) > _ROUNDING:
                at = round(truth.time * truth.block / (truth.block + 1), 9)
                self._slips.append(SlipReport(at, robot, 1e3 * float(distance), float(np.degrees(angle)), None))
            self._known[robot] = now

    def reports(self, latest: Iterable[Estimate]) -> list[SlipReport]:
        """Return all slips in order of time, with the times from the robots' newest estimates."""
        slips = [estimate.slips for estimate in latest]
        return [msgspec.structs.replace(slip, named_at_s=self._named_at(slip, slips)) for slip in self._slips]

    def _named_at(self, slip: SlipReport, noticed: Sequence[Sequence[SlipNotice]]) -> float | None:
        """Return when the last robot had identified a slip, before the grasp slipped again; None if some have not."""
        later = (each.at_s for each in self._slips if each.robot == slip.robot and each.at_s > slip.at_s)
        next_one = min(later, default=np.inf)
        named = [
            [each.named_at for each in own if each.robot == slip.robot and slip.at_s < each.named_at <= next_one]
            for own in noticed
        ]
        return max(map(min, named)) if named and all(named) else None
