"""What an observer has heard of a run."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from coheft.wire.messages import Estimate, Scene, Truth

KEPT_EVERY = 0.1
"""Simulated time between the estimates that are kept [s]."""


@dataclass
class Record:
    """Truths of all blocks, and estimates at a lower rate.

    Which estimates are kept depends on their time alone, so equal runs leave equal records. The last one of each robot
    is always there.

    Attributes:
        scene: Who holds the payload where.
        duration: Of the whole run [s].
        truths: In order of blocks.
        estimates: By robot, in order of blocks.
    """

    scene: Scene
    duration: float
    truths: list[Truth] = field(default_factory=list)
    estimates: dict[str, list[Estimate]] = field(default_factory=dict)

    @property
    def time(self) -> float:
        """Simulated time that has been heard of [s]."""
        return self.truths[-1].time if self.truths else 0.0

    @property
    def silent(self) -> list[str]:
        """Robots that have not said anything yet."""
        return [name for name in self.scene.robots if name not in self.estimates]

    @property
    def complete(self) -> bool:
        """Whether every robot's estimate of the newest truth's block has come."""
        return bool(self.truths) and all(
            name in self.estimates and self.estimates[name][-1].block >= self.truths[-1].block
            for name in self.scene.robots
        )

    def add_truth(self, truth: Truth) -> None:
        """Keep a truth."""
        self.truths.append(truth)

    def add_estimate(self, estimate: Estimate) -> None:
        """Keep an estimate, in the place of the one before it unless that is one to keep."""
        series = self.estimates.setdefault(estimate.robot, [])
        if series and not _ends_an_interval(series[-1]):
            series.pop()
        series.append(estimate)


def _ends_an_interval(estimate: Estimate) -> bool:
    """Whether its block is the last one that ends within an interval of ``KEPT_EVERY``."""
    block_duration = estimate.time / (estimate.block + 1)
    return _interval(estimate.time) != _interval(estimate.time + block_duration)


def _interval(moment: float) -> int:
    """Number of the interval to which a moment belongs; its end belongs to it."""
    return math.ceil(round(moment / KEPT_EVERY, 6))
