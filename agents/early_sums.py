"""Samples from before the start of a team's sums follow, the newest first, through sums of their own."""

from __future__ import annotations

from collections.abc import Mapping

from agents.sums import Entered, TeamSums
from coheft.estimation.spatial import Array, Pose
from coheft.wire.config import AgentConfig
from consensus.schedule import Schedule

EARLY = 10.0
"""How far back from their start the sums reach [s]."""


class EarlySums:
    """One agent's share of them.

    Args:
        config: The agent's settings.
        neighbours: Its neighbours in the team.
        schedule: Of the sums.
        start: First block of the sums of the present.
        history: Own samples of the blocks before, by number. Everybody goes back equally far; whoever does not have a
            block any more lets it be left out.
    """

    def __init__(
        self,
        config: AgentConfig,
        neighbours: tuple[str, ...],
        schedule: Schedule,
        start: int,
        history: Mapping[int, Array],
    ) -> None:
        self._sums = TeamSums("early", config.name, neighbours, schedule, config.block, config.noise)
        self._start = start
        self._end = start + schedule.rounds + min(start, config.blocks(EARLY))
        self._history = dict(history)

    def end(self) -> None:
        """Let no more go through."""
        self._end = 0
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
        """One block enters, carried with ``pose`` of a version, and another leaves: see ``TeamSums.advance``."""
        finished = self._sums.advance(inbox)
        block = 2 * self._start - 1 - index
        samples = self._history.pop(block, None)
        self._sums.enter(None if samples is None else Entered(block, samples, pose, version))
        return finished

    def fit(self, channels: Mapping[str, Array]) -> bool:
        """Whether what a neighbour sent of these sums, if anything, has the right shapes."""
        return self._sums.fit(channels)

    def channels(self) -> dict[str, Array]:
        """What to tell the neighbours."""
        return self._sums.channels()
