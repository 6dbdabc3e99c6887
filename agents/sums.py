"""Own samples on their way through the network's exact sums, and the totals that come out."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from coheft.estimation.measurement import SAMPLE_SIZE, SensorNoise
from coheft.estimation.motion_fusion import CHANNELS, summands
from coheft.estimation.spatial import Array, Pose
from consensus.rounds import make_rounds
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
        self._noise = noise
        # Summands are linear in the samples: what they are of each of a sample's numbers, carried with a pose.
        self._carrying: tuple[Pose | None, Array] = None, np.zeros((SAMPLE_SIZE, CHANNELS))
        self._scale = schedule.scale
        self._rounds = make_rounds(schedule, channel, name, neighbours, samples, CHANNELS)
        self._under_way: deque[Entered | None] = deque([None] * schedule.rounds, maxlen=schedule.rounds)

    def clear(self) -> None:
        """A block was missed: nothing that is under way can be completed."""
        self._rounds.clear()

    def advance(self, inbox: Mapping[str, Mapping[str, Array]]) -> tuple[Entered, Array] | None:
        """Do one round; then ``enter`` the next block.

        Returns:
            The block that has now gone through all rounds, and the team's sums of ``summands``, shape (B, 3, 6); None
            if it is incomplete.
        """
        finished = self._rounds.advance(inbox)
        left = self._under_way.pop()
        if finished is None or left is None or not np.isfinite(finished).all():
            return None
        return left, (self._scale * finished).reshape(-1, 3, 6)

    def enter(self, entered: Entered | None) -> None:
        """Put the next block in; None if there is none."""
        self._under_way.appendleft(entered)
        if entered is None:
            self._rounds.enter(None)
        else:
            self._rounds.enter(self._carried(entered), entered.version)

    def _carried(self, entered: Entered) -> Array:
        """Own ``summands`` in the body frame, shape (B, 18)."""
        pose, carried = self._carrying
        if pose is not entered.pose:
            each = summands(np.eye(SAMPLE_SIZE), self._noise) @ entered.pose.adjoint().T
            carried = each.reshape(SAMPLE_SIZE, CHANNELS)
            self._carrying = entered.pose, carried
        return entered.samples @ carried

    def fit(self, channels: Mapping[str, Array]) -> bool:
        """Whether what a neighbour sent of these sums, if anything, has the right shapes."""
        return self._rounds.fit(channels)

    def channels(self) -> dict[str, Array]:
        """What to tell the neighbours."""
        return self._rounds.channels()
