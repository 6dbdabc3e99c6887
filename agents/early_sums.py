"""Samples from before a team's sums follow, the newest first, through sums of their own.

With the first fit of the team's poses, and after any other poses that proved too rough, all samples of the last ten
seconds follow again: what poses did to them could be corrected to first order only, and whether the load changed
meanwhile, or a sensor was off, would stay unknown.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from agents.sums import Entered, TeamSums
from coheft.estimation.spatial import Array, Pose
from coheft.wire.config import AgentConfig
from consensus.schedule import Schedule

EARLY = 10.0
"""How far back from their start the sums reach [s]."""
PACE = 2
"""So many blocks go back with every step, as one: the past is caught up with in half the time that it took."""


class EarlySums:
    """One agent's share of them.

    Args:
        config: The agent's settings.
        neighbours: Its neighbours in the team.
        schedule: Of the sums.
        start: First block of the sums of the present.
        history: Own samples of the blocks before, by number. Everybody goes back equally far; whoever does not have a
            block any more lets it be left out.

    Attributes:
        start: All blocks before this one go through these sums.
    """

    def __init__(
        self,
        config: AgentConfig,
        neighbours: tuple[str, ...],
        schedule: Schedule,
        start: int,
        history: Mapping[int, Array],
    ) -> None:
        self._config = config
        self._neighbours = neighbours
        self._schedule = schedule
        self._history = dict(sorted(history.items()))
        self.begin(start)

    def begin(self, start: int) -> None:
        """All blocks before this one are to go through, those that have done so already, too."""
        config = self._config
        samples = PACE * config.block
        self._sums = TeamSums("early", config.name, self._neighbours, self._schedule, samples, config.noise)
        self.start = start
        self._end = start + self._schedule.rounds + min(start, config.blocks(EARLY)) // PACE

    def remember(self, block: int, samples: Array) -> None:
        """Own samples of a block, larger than all before, that has to go through if these sums begin again."""
        self._history[block] = samples
        reach = self._config.blocks(EARLY)
        needed = block - reach + 1 if self.are_over(block) else self.start - reach
        while (oldest := next(iter(self._history))) < needed:
            del self._history[oldest]

    def end(self) -> None:
        """Let nothing through of what is remembered."""
        self._end = 0
        self.forget()

    def forget(self) -> None:
        """What is remembered is not to go through, even if these sums begin again."""
        self._history.clear()

    def are_over(self, index: int) -> bool:
        """Whether all have gone through."""
        return index >= self._end

    def clear(self) -> None:
        """A block was missed: nothing that is under way can be completed."""
        self._sums.clear()

    def step(
        self, index: int, pose: Pose, version: int, inbox: Mapping[str, Mapping[str, Array]]
    ) -> tuple[Entered, Array] | None:
        """The next blocks enter, carried with ``pose`` of a version, and others leave: see ``TeamSums.advance``.

        Blocks travel ``PACE`` at a time, as one that has the number of the oldest and the samples of all.
        """
        finished = self._sums.advance(inbox)
        first = self.start - PACE * (index - self.start + 1)
        samples = [self._history[block] for block in range(first, first + PACE) if block in self._history]
        is_whole = len(samples) == PACE
        self._sums.enter(Entered(first, np.concatenate(samples), pose, version) if is_whole else None)
        return finished

    def fit(self, channels: Mapping[str, Array]) -> bool:
        """Whether what a neighbour sent of these sums, if anything, has the right shapes."""
        return self._sums.fit(channels)

    def channels(self) -> dict[str, Array]:
        """What to tell the neighbours."""
        return self._sums.channels()
