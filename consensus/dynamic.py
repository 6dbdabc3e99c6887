"""Dynamic consensus in different coordinates (Fan et al., Proposition 3): track the average of changing inputs.

``x_i' = sum_j w_ij (X_ij x_j - x_i) + u_i'`` in discrete time: add the increment of the input, then do K rounds with
the weights ``w_ij`` that ``NeighbourStages.gains`` give, such as Metropolis weights or equal ones. The sum of all
``x``, transformed to any one frame, always equals the sum of all inputs; the K rounds reduce the disagreement of the
agents by the K-th power of the second largest eigenvalue in magnitude of ``weight_matrix``.

The rounds are pipelined (``coheft.consensus.pipeline``), so the increment is the change of the input over K blocks:
each value starts from the result of the consensus on the block K before it.

If a value is lost, the sum is no longer conserved. Results that depend on it are not used; the agents have to restart,
all at the same block.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from coheft.consensus.pipeline import NeighbourStages, Pipeline
from coheft.estimation.geometry.spatial import Array


def lag_bound(rate: float, rounds: int, moved: float) -> float:
    """Return a bound on the agents' lag behind the average of changing inputs, after the initial transient.

    With ``W`` the matrix of a round, the deviations ``e`` from the average obey ``e' = W^K (e + d)``, where ``d`` is
    the change of the inputs in K blocks, less its mean over the agents; ``|e|`` stays below ``r^K / (1 - r^K) |d|``.

    Args:
        rate: ``r``, see ``coheft.consensus.graph.convergence_rate``.
        rounds: ``K``, the rounds per block; also the number of blocks that a value takes.
        moved: Largest ``|d|``: the norm over all agents, in one frame, of any of the channels.

    Returns:
        Largest ``|e|``, over the same agents, in the same frame and the same channel.
    """
    left = rate**rounds
    return left / (1.0 - left) * moved


class Extrapolation(NamedTuple):
    """What the last of some rounds shows of the disagreement that is left after it.

    A part with eigenvalue ``l`` of a round's matrix is ``l^K c`` after K rounds, and ``(l^K - l^(K-1)) c`` is what the
    last one has changed. The factor is that of least squares if all parts begin alike. With rounds enough, only the
    slowest part is left, of which nearly all is removed; with few of them, the factor is small.

    Attributes:
        factor: Times the last change, it is added to the values.
        left: ``|after - factor change| / |change|``: the remaining disagreement, relative to the last change.
        share: ``|after - factor change| / |after|``: the same, relative to the disagreement without extrapolation.
    """

    factor: float
    left: float
    share: float

    @staticmethod
    def of(matrix: Array, rounds: int) -> Extrapolation:
        """Return it for values that go through so many rounds; ``matrix`` as for ``convergence_rate``."""
        eigenvalues = np.linalg.eigvalsh(matrix)[:-1]  # all but that of the mean
        before = eigenvalues ** (rounds - 1)
        after, change = before * eigenvalues, before * (1.0 - eigenvalues)
        size = float(change @ change)
        if size == 0.0:
            return Extrapolation(0.0, 0.0, 0.0)
        factor = float(after @ change) / size
        left, plain = float(np.linalg.norm(after - factor * change)), float(np.linalg.norm(after))
        return Extrapolation(factor, left / size**0.5, left / plain if plain > 0.0 else 0.0)

    def settled(self, after: Array, before: Array) -> Array:
        """Return what more rounds would make of values, from those after the last round and before it, of any shape."""
        return after + self.factor * (after - before)


class DynamicConsensus:
    """One agent's part in a dynamic consensus on blocks of samples.

    Its ``pipeline`` holds what to send: ``pipeline.sent()`` after each step.

    Args:
        rounds: ``K``, rounds per block.
        samples: ``B``, samples per block.
        channels: ``C``, numbers per sample.
    """

    def __init__(self, rounds: int, samples: int, channels: int) -> None:
        self.pipeline = Pipeline(rounds, samples, channels)
        self._inputs: deque[Array] = deque(maxlen=rounds)
        self.is_broken = False
        """Whether a value was lost, so that this agent no longer takes part."""

    def step(self, inputs: Array, neighbours: Sequence[NeighbourStages]) -> Array | None:
        """Process one block.

        Args:
            inputs: ``u_i`` of the new block, in the agent's own frame, shape (B, C).
            neighbours: The messages that they sent after the previous block, with transports and gains.

        Returns:
            This agent's estimate of the network's average for the block entered K blocks before, in its own frame,
            shape (B, C). None during the first K blocks, or if a value was lost.
        """
        own_gains = 1.0 - sum((neighbour.gains for neighbour in neighbours), np.zeros(self.pipeline.rounds))
        finished = self.pipeline.advance(neighbours, own_gains)
        if len(self._inputs) < self.pipeline.rounds:
            self.pipeline.enter(inputs)
        elif finished is None:
            self.is_broken = True
            self.pipeline.enter(None)
        else:
            self.pipeline.enter(finished + inputs - self._inputs[0])
        self._inputs.append(inputs)
        return finished
