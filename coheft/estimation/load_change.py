"""Which samples still count: memories that notice, or slowly outlive, a change of the load.

``LoadWindow`` keeps everything since the last change. It remembers ``O(log n)`` borders between blocks, dense among the
newest and ever sparser towards the oldest, and for each the sum of all that came after it. For every border it can so
compare "one load all along" with "another load since this border": an adaptive window after Bifet and Gavalda (2007),
with a generalised likelihood ratio test (Basseville and Nikiforov 1993) in place of a difference of means.

``ForgettingWindow`` is the classical alternative, exponential forgetting, kept from forgetting what no longer shows.

Both are plain state machines: what they do depends on what they were told, on nothing else. They take packed Gram
matrices of blocks (``inertia.packed_gram``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy.special import chdtri

from coheft.estimation.inertia import GRAM_SIZE, InertiaInformation, InertiaModel
from coheft.estimation.spatial import Array

FALSE_ALARM = 1e-12
"""Probability that a single test reports a change where there is none. Tests of one border on successive blocks, and of
neighbouring borders, have much data in common."""
_SIGNAL = 0.2
"""Directions are tested in which at least this share of the information is motion, and not noise of motion."""


@dataclass(frozen=True)
class LoadChange:
    """A change of the load that was found.

    Attributes:
        first_block: The first block with the new load; everything before it was forgotten.
        last_block: The newest block when the change was found.
        statistic: Twice the logarithm of the likelihood ratio.
    """

    first_block: int
    last_block: int
    statistic: float


class Memory(Protocol):
    """What holds the samples that count."""

    def push(self, block: int, gram: Array) -> None:
        """Take in a block: its number, larger than all before, and packed Gram matrix (190,)."""

    def review(self, model: InertiaModel) -> LoadChange | None:
        """Look at what is remembered, and forget what belongs to another load."""

    def forget_before(self, block: int) -> None:
        """Forget all blocks with smaller numbers: somebody else found a change."""

    def information(self, model: InertiaModel) -> InertiaInformation:
        """All that counts."""


class LoadWindow:
    """All blocks since the load last changed.

    Args:
        resolution: Borders remain at most about ``1 / resolution`` of their age apart.
        stride: A review tests every ``stride``-th border, others the next time. After a detection all are tested.
        false_alarm: Probability of one at a single test.
    """

    def __init__(self, resolution: int = 8, stride: int = 3, false_alarm: float = FALSE_ALARM) -> None:
        self._resolution = resolution
        self._stride = stride
        self._false_alarm = false_alarm
        self._reviews = 0
        self._count = 0
        self._last_block = -1
        # Border k is the beginning of block _firsts[k], the _orders[k]-th that came; _sums[k] is all that came since.
        self._firsts = np.zeros(64, dtype=np.int64)
        self._orders = np.zeros(64, dtype=np.int64)
        self._sums = np.zeros((64, GRAM_SIZE))
        self._borders = 0

    @property
    def first_block(self) -> int:
        """Number of the oldest block that counts; only meaningful after the first ``push``."""
        return int(self._firsts[0])

    def push(self, block: int, gram: Array) -> None:
        """Take in a block: its number, larger than all before, and packed Gram matrix (190,)."""
        self._thin_out()
        if self._borders == len(self._firsts):
            self._firsts = np.concatenate([self._firsts, np.zeros_like(self._firsts)])
            self._orders = np.concatenate([self._orders, np.zeros_like(self._orders)])
            self._sums = np.concatenate([self._sums, np.zeros_like(self._sums)])
        end = self._borders
        self._firsts[end], self._orders[end] = block, self._count
        self._sums[end] = 0.0
        self._borders += 1
        self._sums[: self._borders] += gram
        self._count += 1
        self._last_block = block

    def review(self, model: InertiaModel) -> LoadChange | None:
        """Test whether the load changed at one of the borders; if so, forget all that is older than the likeliest."""
        phase = 1 + self._reviews % self._stride
        self._reviews += 1
        statistics, threshold = self._statistics(model, slice(phase, self._borders, self._stride))
        if not np.any(statistics > threshold):
            return None
        statistics, _ = self._statistics(model, slice(1, self._borders))
        found = int(np.argmax(statistics))
        change = LoadChange(int(self._firsts[1 + found]), self._last_block, float(statistics[found]))
        self.forget_before(change.first_block)
        return change

    def forget_before(self, block: int) -> None:
        """Forget all blocks with smaller numbers, and those that cannot be told apart from them any more."""
        kept = int(np.searchsorted(self._firsts[: self._borders], block))
        end = self._borders - kept
        for array in (self._firsts, self._orders, self._sums):
            array[:end] = array[kept : self._borders].copy()
        self._borders = end

    def information(self, model: InertiaModel) -> InertiaInformation:
        """Of all blocks since the last change."""
        return model.information(self._sums[0] if self._borders else np.zeros(GRAM_SIZE))

    def _thin_out(self) -> None:
        """Drop the newest border whose neighbours are close to each other for their age."""
        orders = self._orders[: self._borders]
        close = (orders[2:] - orders[:-2]) * self._resolution <= self._count - orders[2:]
        if close.any():
            drop = 1 + int(np.flatnonzero(close)[-1])
            for array in (self._firsts, self._orders, self._sums):
                array[drop : self._borders - 1] = array[drop + 1 : self._borders].copy()
            self._borders -= 1

    def _statistics(self, model: InertiaModel, borders: slice) -> tuple[Array, float]:
        """Statistic of each border, chi-square if nothing changed, and the threshold.

        If the load is one, the score of the newer part, ``u = vector - matrix @ estimate`` with the estimate from all,
        has mean zero and a known covariance ``C``, and the statistic is ``u^T C^-1 u``. Without noise in the regressor
        this equals ``RSS(all) - RSS(older) - RSS(newer)``; with it, unlike that, it stays true when the load is at
        rest for a while, and noise is all there is to see.
        """
        sums = self._sums[borders]
        if len(sums) == 0:
            return np.empty(0), np.inf
        everything, newer = model.information(self._sums[0]), model.information(sums)
        # Coordinates in which the score covariance of everything is the identity, and its matrix the diagonal shares.
        covariance = everything.score_covariance
        scale = 1.0 / np.sqrt(np.diag(covariance))
        balanced = scale[:, None] * covariance * scale + 1e-12 * np.eye(len(scale))
        whitening = np.linalg.inv(np.linalg.cholesky(balanced)) * scale
        shares, directions = np.linalg.eigh(whitening @ everything.matrix @ whitening.T)
        seen = shares > _SIGNAL
        if not seen.any():
            return np.zeros(len(sums)), np.inf
        basis, shares = directions[:, seen].T @ whitening, shares[seen]
        gain = basis @ newer.matrix @ basis.T / shares
        score = newer.vector @ basis.T - gain @ (basis @ everything.vector)
        own = basis @ newer.score_covariance @ basis.T
        cross = gain @ own
        spread = own - cross - cross.swapaxes(-1, -2) + gain @ gain.swapaxes(-1, -2)
        spread += 1e-9 * np.eye(len(basis))
        statistics = np.einsum("ki,ki->k", score, np.linalg.solve(spread, score[..., None])[..., 0])
        return statistics, float(chdtri(len(basis), self._false_alarm))


class ForgettingWindow:
    """Exponential forgetting, down to a floor.

    Args:
        memory: Blocks after which ``1/e`` of a block's weight is left.
        floor: Standard deviation (u,) of the unknowns ``theta`` (and offset) up to which information may be lost. In
            directions that no longer show, the estimate stays where it was, with this uncertainty.
    """

    def __init__(self, memory: float, floor: Array) -> None:
        self._factor = float(np.exp(-1.0 / memory))
        self._floor = np.diag(floor**-2.0)
        self._anchor = np.zeros(len(floor))
        self._gram = np.zeros(GRAM_SIZE)
        self._gram_of_squared_weights = np.zeros(GRAM_SIZE)

    def push(self, block: int, gram: Array) -> None:
        """Take in a block: packed Gram matrix (190,); its number does not matter."""
        self._gram = self._factor * self._gram + gram
        self._gram_of_squared_weights = self._factor**2 * self._gram_of_squared_weights + gram

    def review(self, model: InertiaModel) -> None:
        """Remember the estimate, to stay there in directions that are not going to show."""
        information = self.information(model)
        self._anchor = np.linalg.solve(information.matrix, information.vector)

    def forget_before(self, block: int) -> None:
        """Nothing: older blocks fade by themselves."""

    def information(self, model: InertiaModel) -> InertiaInformation:
        """Of all blocks with their weights, and the floor."""
        information = model.information(self._gram)
        spread = model.information(self._gram_of_squared_weights).score_covariance
        return replace(
            information,
            matrix=information.matrix + self._floor,
            vector=information.vector + self._floor @ self._anchor,
            score_covariance=spread + self._floor,
        )
