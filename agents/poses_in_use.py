"""The poses of a team that samples are seen with now, and the switch to new ones.

New poses come into use with the first block that was carried with them and leaves the sums. From then on everything
that was summed before is *mapped*: to first order, it is what these poses would have given.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from agents.contradictions import Contradictions
from agents.pose_fits import UNTRIED, PoseFits
from agents.sums import Entered
from agents.total_motion import TotalMotion
from coheft.estimation.body_motion import perturbation_between
from coheft.estimation.observability import PoseEstimate
from coheft.estimation.spatial import Array, Pose
from coheft.estimation.team_registration import TeamPoses, refit_map, seen_from
from coheft.wire.config import AgentConfig


@dataclass(frozen=True, eq=False)
class Switch:
    """Poses have come into use.

    Attributes:
        old: Of all robots, in use before.
        new: In use now.
        feature_map: What it makes of samples' features of registration, ``refit_map`` (28, 28).
        largest_step: How far it has moved a pose, in its standard deviations.
    """

    old: tuple[Pose, ...]
    new: tuple[Pose, ...]
    feature_map: Array
    largest_step: float


class PosesInUse:
    """One robot's, of its whole team.

    Args:
        config: The robot's settings.
        names: Of the team, in its order.
        poses: Of all of it in the body frame, in use at first.
        known: How well, None if nobody knows.
        fits: Find new ones.
        contradictions: Held against these.
        optimism: How many times larger fits' errors are than what is said of them.
        untried: As of ``PoseFits.known``.

    Attributes:
        poses: Of all robots in the body frame.
        version: Their number, 0 at first.
        known: How well, None if nobody knows.
        motion: Of the body, as seen with them.
    """

    def __init__(
        self,
        config: AgentConfig,
        names: Sequence[str],
        poses: tuple[Pose, ...],
        known: TeamPoses | None,
        fits: PoseFits,
        contradictions: Contradictions,
        optimism: float = 1.0,
        untried: float = UNTRIED,
    ) -> None:
        self.poses, self.version, self.known = poses, 0, known
        self.motion = TotalMotion(config, poses)
        self._config = config
        self._names = names
        self._own = names.index(config.name)
        self._fits = fits
        self._contradictions = contradictions
        self._optimism, self._untried = optimism, untried
        self._neighbours: dict[str, PoseEstimate] | None = None

    @property
    def own(self) -> Pose:
        """Of this robot in the body frame."""
        return self.poses[self._own]

    @property
    def may_be_spoilt(self) -> bool:
        """Whether something may have spoilt the samples that they were fitted to."""
        return self._fits.may_be_spoilt(self.version)

    def neighbours(self, names: Sequence[str]) -> Mapping[str, PoseEstimate]:
        """Poses of neighbours in the own frame, by name; none if nobody knows how well."""
        if self.known is None:
            return {}
        if self._neighbours is None:
            self._neighbours = seen_from(self.known, self._config.name, self._names, names)
        return self._neighbours

    def fit(self, index: int, *, is_settled: bool, is_spoilt: bool, are_rough: bool, come_again: bool) -> None:
        """Whatever is due at a block, see ``PoseFits.step``."""
        self._fits.step(
            index,
            self.version,
            self.poses,
            self.motion.slope,
            is_settled=is_settled,
            is_spoilt=is_spoilt,
            are_rough=are_rough,
            come_again=come_again,
        )

    def carried(self, block: int, samples: Array | None) -> Entered | None:
        """Own samples of a block as they enter the sums: with the newest poses that everybody has, in use or not."""
        if samples is None:
            return None
        return Entered(block, samples, self._fits.carrying_pose(self.poses), self._fits.carried)

    def switch(self, version: int) -> Switch:
        """All samples so far count from now on as if they had been carried with the poses of a version."""
        old, new = self.poses, self._fits.take_poses(version)
        self.motion.set_poses(new)
        feature_map = refit_map(old, new, self._config.noise, self.motion.slope)
        self._fits.map(feature_map)
        self._contradictions.map(feature_map)
        steps = [perturbation_between(before, now) for before, now in zip(old, new, strict=True)]
        self.poses, self.version = new, version
        self.known = self._fits.known(new, steps, self.motion.slope, self._untried)
        self._neighbours = None
        self._contradictions.use_pose(self.own, self._optimism * self.known.deviations.max(axis=0))
        largest = float(np.max(np.abs(steps[1:]) / self.known.deviations[1:]))
        return Switch(old, new, feature_map, largest)

    def forget_how_well(self, deviations: Array) -> None:
        """Nobody knows any more how well they are known: within ``deviations`` (6,) [rad, m], if at all."""
        self._fits.forget_prior()
        self.known, self._neighbours = None, None
        self._contradictions.use_pose(self.own, deviations)
