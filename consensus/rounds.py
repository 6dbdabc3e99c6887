"""One agent's values in the rounds of a schedule. Each value has a version number, which all its summands must share.

To compute sums, call ``advance`` and then ``enter`` for each block, and send ``channels`` to the neighbours.
``advance`` returns the network's result of the block entered K blocks before, or None if a value was missing.
"""

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from coheft.consensus.pipeline import NeighbourStages, Pipeline
from coheft.consensus.schedule import LaplacianSchedule, Schedule, TreeSchedule
from coheft.consensus.tree_rounds import TreeRounds
from coheft.estimation.geometry.spatial import Array

Inbox = Mapping[str, Mapping[str, Array]]


class Rounds(Protocol):
    """Values (B, C) in progress, for any kind of schedule."""

    def advance(self, inbox: Inbox) -> Array | None:
        """Do one round with the neighbours' messages; return the result of the block entered K blocks before."""

    def enter(self, values: Array | None, version: int = 0) -> None:
        """Enter the next block, with its version number (at least 0); None if there is no block."""

    def clear(self) -> None:
        """Mark all values in progress as invalid, because a block was missed."""

    def fit(self, channels: Mapping[str, Array]) -> bool:
        """Whether a neighbour's arrays for these values, if any, have the right shapes."""

    def channels(self) -> dict[str, Array]:
        """Return the arrays to send to all neighbours."""


def make_rounds(
    schedule: Schedule,
    channel: str,
    name: str,
    neighbours: tuple[str, ...],
    samples: int,
    width: int,
    transports: Mapping[str, Array] | None = None,
) -> Rounds:
    """Make one agent's share of a schedule's rounds.

    Args:
        schedule: The team's schedule.
        channel: Name of the values in messages.
        name: This agent's name.
        neighbours: Its neighbours' names.
        samples: ``B``, samples per block.
        width: ``C``, numbers per sample.
        transports: ``X_ij`` by neighbour, shape (C, C) each: transforms values from the neighbour's frame to this
            agent's, with ``X_ij X_jk = X_ik``. None if all agents use one frame.

    Returns:
        Rounds whose results are in the agent's own frame; multiplied by ``schedule.scale``, they are the sums of all
        agents' values.
    """
    if isinstance(schedule, TreeSchedule):
        return TreeRounds(schedule, channel, name, neighbours, samples, width, transports)
    return StageRounds(schedule, channel, name, neighbours, samples, width, transports)


class StageRounds:
    """Rounds with the graph Laplacian, in which neighbours exchange all K blocks in progress. See ``Rounds``."""

    def __init__(
        self,
        schedule: LaplacianSchedule,
        channel: str,
        name: str,
        neighbours: tuple[str, ...],
        samples: int,
        width: int,
        transports: Mapping[str, Array] | None = None,
    ) -> None:
        self._transports = transports or {}
        self._channel, self._channel_versions = channel, f"{channel}_versions"
        self._own_gains = schedule.gains(name, name)
        self._gains = {other: schedule.gains(name, other) for other in neighbours}
        self._pipeline = Pipeline(schedule.rounds, samples, width)
        self._versions = np.full(schedule.rounds, -1.0)

    def advance(self, inbox: Inbox) -> Array | None:
        """See ``Rounds``."""
        own, stages = self._versions, []
        for name, gains in self._gains.items():
            channels = inbox.get(name, {})
            versions = channels.get(self._channel_versions)
            valid = None if versions is None or versions.shape != own.shape else versions == own
            stages.append(NeighbourStages(self._transports.get(name), gains, channels.get(self._channel), valid))
        return self._pipeline.advance(stages, self._own_gains)

    def enter(self, values: Array | None, version: int = 0) -> None:
        """See ``Rounds``."""
        self._versions[1:] = self._versions[:-1].copy()
        self._versions[0] = -1 if values is None else version
        self._pipeline.enter(values)

    def clear(self) -> None:
        """See ``Rounds``."""
        self._pipeline.clear()

    def fit(self, channels: Mapping[str, Array]) -> bool:
        """See ``Rounds``."""
        stages, versions = channels.get(self._channel), channels.get(self._channel_versions)
        return (stages is None or stages.shape == self._pipeline.stages.shape) and (
            versions is None or versions.shape == (self._pipeline.rounds,)
        )

    def channels(self) -> dict[str, Array]:
        """See ``Rounds``."""
        versions = np.where(self._pipeline.valid, self._versions, -1.0)
        return {self._channel: self._pipeline.stages, self._channel_versions: versions}
