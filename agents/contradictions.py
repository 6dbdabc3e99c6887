"""Whose sensors contradict the motion of the team: what robots find of themselves, and tell each other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from agents.early_sums import PACE
from agents.inbox import AHEAD
from agents.regular import Regular
from agents.watch import MISFIT, Watch
from coheft.estimation.registration import RegistrationMoments
from coheft.estimation.spatial import Array, Pose
from coheft.wire.config import AgentConfig
from consensus.flood import Flood

_BLAMED = 0.6
"""After so long a contradiction a robot starts over [s]."""
_ROUNDS = 2.0
"""Where blame goes round it takes so many times as long."""
_EXCUSED = 0.5
"""While nobody's pose is known well, a block without a contradiction makes up for so many with one: when all are wrong,
blame comes and goes."""
_TOLD = 0.1
"""Robots look so often how their sensors fit the team's motion, and tell each other if they do not [s]."""


class Contradictions:
    """One robot's part in watching the team.

    Args:
        config: The robot's settings.
        names: Of the team, in its order.
        pose: The own one.
        deviations: Standard deviations of poses' perturbations in the axes of the body frame, shape (6,): the
            largest of all robots [rad, m].

    Attributes:
        flood: Tells the others how badly the own sensors fit, once they do not, and hears the same of them.
    """

    def __init__(self, config: AgentConfig, names: Sequence[str], pose: Pose, deviations: Array) -> None:
        self.flood = Flood(len(names), 1)
        self._names = names
        self._own = names.index(config.name)
        blocks_per_second = config.rate / config.block
        self._watch, self._early_watch = (Watch(config.noise, blocks_per_second / pace) for pace in (1, PACE))
        self._looks = Regular(config.blocks(_TOLD))
        self._patience = config.blocks(_BLAMED)
        self._blamed, self._anybody_blamed = 0, 0.0
        self._told = 0.0
        self._is_wrong = self._has_looked = False
        self.use_pose(pose, deviations)

    def use_pose(self, pose: Pose, deviations: Array) -> None:
        """From now on sensors are held against the team's motion with this pose; arguments as of the class."""
        self._pose, self._variances = pose, deviations**2

    def add(self, moments: RegistrationMoments) -> bool:
        """Take in what a block says of the own pose; returns whether it is like those of late."""
        self._has_looked = True
        return self._watch.add(moments, self._pose, self._variances)

    def add_early(self, moments: RegistrationMoments) -> bool:
        """The same of blocks that came early, ``PACE`` of them."""
        self._has_looked = True
        return self._early_watch.add(moments, self._pose, self._variances)

    def forget_early(self) -> None:
        """They do not matter any more."""
        self._early_watch.clear()

    def map(self, feature_map: Array) -> None:
        """As if every sample's features had been ``feature_map`` (28, 28) times what they were."""
        self._watch.map(feature_map)
        self._early_watch.map(feature_map)

    def step(self, index: int) -> None:
        """One block, by its number."""
        if self._looks.is_due(index):
            misfit = max(watch.misfit(self._pose, self._variances) for watch in (self._watch, self._early_watch))
            if max(misfit, self._told) > MISFIT:
                self.flood.tell(self._own, index, np.array([misfit]))
                self._told = misfit
        if self._has_looked:  # without complete sums nothing is known better than before
            self._count_blame()
        self._has_looked = False
        # Nobody can have told that yet, and it would win over all that the robot tells until then.
        self._is_wrong = self.flood.newest > index + AHEAD

    def _count_blame(self) -> None:
        """One more block that somebody is blamed in, or nobody; one that is blamed again and again is blamed, too."""
        suspect = self.suspect
        if suspect is None:
            self._blamed, self._anybody_blamed = max(0, self._blamed - 1), max(0.0, self._anybody_blamed - _EXCUSED)
        else:
            self._blamed += suspect == self._names[self._own]
            self._anybody_blamed += 1

    @property
    def suspect(self) -> str | None:
        """The robot whose measurements contradict the team's motion most, if any do."""
        if self.flood.newest < 0:
            return None  # nobody has ever told of any
        misfits = self.flood.table[:, 1]
        worst = int(misfits.argmax())
        return self._names[worst] if misfits[worst] > MISFIT else None

    @property
    def doubt(self) -> str | None:
        """The same in words."""
        return None if self.suspect is None else f"what {self.suspect} measures contradicts how the load moves"

    @property
    def have_lasted(self) -> bool:
        """Whether this robot's measurements have contradicted the team's motion for too long.

        What was learned before it was noticed may be wrong, and then the contradiction would never end. So may be what
        is known of others' misfits.
        """
        return self._is_wrong or self._blamed > self._patience

    @property
    def is_own_turn(self) -> bool:
        """Whether contradictions have come and gone for long, and it is this robot's turn to be blamed for them."""
        return self.suspect == self._names[self._own] and self._anybody_blamed > _ROUNDS * self._patience

    @property
    def anybodys_have_lasted(self) -> bool:
        """The same of all robots' measurements, whoever was blamed for it."""
        return self._is_wrong or self._anybody_blamed > self._patience
