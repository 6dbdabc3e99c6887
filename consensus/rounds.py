"""One agent's values on their way through a schedule's rounds, each with a number that all of its summands must share.

Whoever wants a sum lets a block of values ``enter`` after each ``advance``, tells its neighbours ``channels``, and gets
the network's result K blocks later, or None where anything was missing on the way.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from coheft.consensus.pipeline import NeighbourStages, Pipeline
from coheft.consensus.schedule import LaplacianSchedule, Schedule, TreeSchedule
from coheft.consensus.tree_rounds import TreeRounds
from coheft.estimation.geometry.spatial import Array

Inbox = Mapping[str, Mapping[str, Array]]


class Rounds(Protocol):
    """Values (B, C) under way, for any kind of schedule."""

    def advance(self, inbox: Inbox) -> Array | None:
        """Do one round with the neighbours' messages; returns the result for the block that entered K blocks before."""

    def enter(self, values: Array | None, version: int = 0) -> None:
        """Enter the next block, with its number of at least 0; None if there is none."""

    def clear(self) -> None:
        """A block was missed: nothing that is under way can be completed."""

    def fit(self, channels: Mapping[str, Array]) -> bool:
        """Whether a neighbour's message about these values, if any, has the right shapes."""

    def channels(self) -> dict[str, Array]:
        """What to tell all neighbours."""


def make_rounds(
    schedule: Schedule,
    channel: str,
    name: str,
    neighbours: tuple[str, ...],
    samples: int,
    width: int,
    transports: Mapping[str, Array] | None = None,
) -> Rounds:
    """One agent's share of a schedule.

    Args:
        schedule: The team's.
        channel: Name under which neighbours hear of the values.
        name: Of this agent.
        neighbours: Its neighbours.
        samples: ``B``, samples per block.
        width: ``C``, numbers per sample.
        transports: ``X_ij`` by neighbour, shape (C, C) each: what carries its values from its frame to the agent's,
            with ``X_ij X_jk = X_ik``. None if all agents use one frame.

    Returns:
        Results are in the agent's own frame; those times ``schedule.scale`` are the sums of all agents' values.
    """
    if isinstance(schedule, TreeSchedule):
        return TreeRounds(schedule, channel, name, neighbours, samples, width, transports)
    return StageRounds(schedule, channel, name, neighbours, samples, width, transports)


class StageRounds:
    """Rounds of the Laplacian: neighbours tell each other all K blocks under way. See ``Rounds``."""

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
