"""Own samples on their way through the network's exact sums, and the totals that come out."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from coheft.estimation.acceleration import CHANNELS, summands
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.spatial import Array, Pose
from consensus.pipeline import NeighbourStages, Pipeline
from consensus.schedule import Schedule


@dataclass(frozen=True, eq=False)
class Entered:
    """A block of own samples, and the own pose that it is carried with.

    Attributes:
        block: Its number.
        samples: Shape (B, 15).
        pose: In the body frame.
        version: Number of the team's poses that this one belongs to.
    """

    block: int
    samples: Array
    pose: Pose
    version: int


class TeamSums:
    """One agent's share of the sums over a team, in the body frame.

    A sum of samples that were carried with poses of different versions is incomplete, and never used.

    Args:
        channel: Name under which neighbours hear of it.
        name: Of this robot.
        neighbours: Its neighbours in the team.
        schedule: Of the sums.
        samples: Per block.
        noise: Of this robot's sensors.
    """

    def __init__(
        self,
        channel: str,
        name: str,
        neighbours: tuple[str, ...],
        schedule: Schedule,
        samples: int,
        noise: SensorNoise,
    ) -> None:
        self._channel = channel
        self._noise = noise
        self._scale = schedule.scale
        self._own_gains = schedule.gains(name, name)
        self._gains = {other: schedule.gains(name, other) for other in neighbours}
        self._pipeline = Pipeline(schedule.rounds, samples, CHANNELS)
        self._under_way: deque[Entered | None] = deque([None] * schedule.rounds, maxlen=schedule.rounds)

    def clear(self) -> None:
        """A block was missed: nothing that is under way can be completed."""
        self._pipeline.valid[:] = False

    def advance(self, inbox: Mapping[str, Mapping[str, Array]]) -> tuple[Entered, Array] | None:
        """Do one round; then ``enter`` the next block.

        Returns:
            The block that has now gone through all rounds, and the team's sums of ``summands``, shape (B, 3, 6); None
            if it is incomplete.
        """
        finished = self._pipeline.advance(self._stages(inbox), self._own_gains)
        left = self._under_way.pop()
        if finished is None or left is None or not np.isfinite(finished).all():
            return None
        return left, (self._scale * finished).reshape(-1, 3, 6)

    def enter(self, entered: Entered | None) -> None:
        """Put the next block in; None if there is none."""
        self._under_way.appendleft(entered)
        if entered is None:
            self._pipeline.enter(None)
            return
        own = summands(entered.samples, self._noise) @ entered.pose.adjoint().T
        self._pipeline.enter(own.reshape(len(own), CHANNELS))

    def fit(self, channels: Mapping[str, Array]) -> bool:
        """Whether what a neighbour sent of these sums, if anything, has the right shapes."""
        stages, versions = channels.get(self._channel), channels.get(f"{self._channel}_versions")
        rounds = (self._pipeline.rounds,)
        return (stages is None or stages.shape == self._pipeline.stages.shape) and (
            versions is None or versions.shape == rounds
        )

    def channels(self) -> dict[str, Array]:
        """What to tell the neighbours."""
        versions = np.where(self._pipeline.valid, self._versions(), -1.0)
        return {self._channel: self._pipeline.stages.copy(), f"{self._channel}_versions": versions}

    def _versions(self) -> Array:
        return np.array([-1.0 if entered is None else float(entered.version) for entered in self._under_way])

    def _stages(self, inbox: Mapping[str, Mapping[str, Array]]) -> list[NeighbourStages]:
        own, stages = self._versions(), []
        for name, gains in self._gains.items():
            channels = inbox.get(name, {})
            versions = channels.get(f"{self._channel}_versions")
            valid = None if versions is None or versions.shape != own.shape else (versions == own) & (versions >= 0.0)
            stages.append(NeighbourStages(None, gains, channels.get(self._channel), valid))
        return stages
