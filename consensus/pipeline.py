"""Rounds of consensus in different coordinates, one round per block for every block of samples in progress.

A sample's value goes through ``K`` rounds ``x_i <- g_i x_i + sum_j g_ij X_ij x_j``. If all rounds of a block were done
before the next block, each block would take ``K`` messages. Instead, one message per block carries the ``K`` blocks in
progress: ``stages[s]`` is the block that entered ``s`` blocks ago, after ``s`` rounds. Every block leaves exactly ``K``
blocks later, with its own number, so that it can be paired with its own kinematics.

If a round cannot be completed because a neighbour's message is missing, has another shape or is itself incomplete, the
value is marked invalid and never used.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from coheft.estimation.geometry.spatial import Array


@dataclass(frozen=True, eq=False)
class NeighbourStages:
    """Message of one neighbour, with the transport and the gains to apply to it.

    Attributes:
        transport: ``X_ij``, shape (C, C): transforms C channels from ``F_j`` to ``F_i``; None if both use one frame.
        gains: ``g_ij`` of each round, shape (K,).
        stages: The neighbour's ``Pipeline.stages``; None if its message is missing.
        valid: The neighbour's ``Pipeline.valid``.
    """

    transport: Array | None
    gains: Array
    stages: Array | None
    valid: npt.NDArray[np.bool_] | None


class Pipeline:
    """One agent's values in progress.

    Attributes:
        stages: Shape (K, B, C): values to send, in the agent's frame.
        valid: Shape (K,): whether each of them is complete so far.
    """

    def __init__(self, rounds: int, samples: int, channels: int) -> None:
        if min(rounds, samples, channels) < 1:
            raise ValueError(f"{rounds} rounds of {samples} x {channels} numbers, but each has to be at least 1")
        self.stages = np.zeros((rounds, samples, channels))
        self.valid = np.zeros(rounds, dtype=np.bool_)

    @property
    def rounds(self) -> int:
        """``K``: rounds per value, and blocks that a value takes."""
        return len(self.stages)

    def advance(self, neighbours: Sequence[NeighbourStages], own_gains: Array) -> Array | None:
        """Do one round for every stage, with the neighbours' stages of the same block.

        Args:
            neighbours: Their messages.
            own_gains: ``g_i`` of each round, shape (K,).

        Returns:
            The values (B, C) of the block that has completed all rounds, or None if it is incomplete. Call ``enter``
            with the next block afterwards.
        """
        # One place more than there are stages: a round moves every value to the next place, and the last one leaves.
        places = np.empty((self.rounds + 1, *self.stages.shape[1:]))
        moved = np.multiply(own_gains[:, None, None], self.stages, out=places[1:])
        valid = self.valid.copy()
        for neighbour in neighbours:
            if neighbour.stages is None or neighbour.valid is None or not self._fits(neighbour.stages, neighbour.valid):
                valid[:] = False
                continue
            transported = neighbour.stages
            if neighbour.transport is not None:
                transported = transported.reshape(-1, transported.shape[2]) @ neighbour.transport.T
            moved += neighbour.gains[:, None, None] * transported.reshape(moved.shape)
            valid &= neighbour.valid
        self.stages, self.valid[1:] = places[:-1], valid[:-1]
        return places[-1] if valid[-1] else None

    def sent(self) -> tuple[Array, npt.NDArray[np.bool_]]:
        """Return copies of ``stages`` and ``valid``, to send to every neighbour after ``enter``."""
        return self.stages.copy(), self.valid.copy()

    def clear(self) -> None:
        """Mark all values in progress as invalid, because a block was missed."""
        self.valid[:] = False

    def _fits(self, stages: Array, valid: npt.NDArray[np.bool_]) -> bool:
        return stages.shape == self.stages.shape and valid.shape == self.valid.shape

    def enter(self, values: Array | None) -> None:
        """Enter the values (B, C) of the next block; None if the agent has none."""
        self.valid[0] = values is not None
        self.stages[0] = 0.0 if values is None else values
