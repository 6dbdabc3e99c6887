"""Which samples still count: exponential forgetting, the classical alternative to noticing load changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from coheft.estimation.inertia import GRAM_SIZE, InertiaInformation, InertiaModel
from coheft.estimation.load_comparison import KnownLoad, signal_directions
from coheft.estimation.spatial import Array

_SHOWN = 0.5
"""The estimate stays where it is in directions in which a smaller share of the information is motion: there are few
samples to tell motion from its noise."""


class ForgettingWindow:
    """Exponential forgetting, down to a floor.

    Args:
        memory: Blocks after which ``1/e`` of a block's weight is left. There should be a review for each block.
        floor: Standard deviation (u,) of the unknowns ``theta`` (and offset) up to which information may be lost. In
            directions that no longer show, the estimate stays where it was, with this uncertainty.
        riders: Numbers per block that are summed along with the Gram matrix, for the caller's use.
    """

    def __init__(self, memory: float, floor: Array, riders: int = 0) -> None:
        self._factor = float(np.exp(-1.0 / memory))
        self._floor = np.diag(floor**-2.0)
        self._anchor: Array = np.zeros(len(floor))
        # Sums with the blocks' weights, and with their squares.
        self._sums = np.zeros((2, GRAM_SIZE + riders))
        self._factors = np.array([[self._factor], [self._factor**2]])

    @property
    def kept(self) -> float:
        """See ``Memory``."""
        return self._factor

    @property
    def doubt(self) -> float:
        """One: nothing is tested."""
        return 1.0

    @property
    def former(self) -> None:
        """None: changes are not looked for."""

    def known_load(self, model: InertiaModel) -> None:
        """None: samples of one load cannot be told from those of another."""

    def expect(self, load: KnownLoad) -> None:
        """Nothing is compared with it."""

    def reconsider(self) -> None:
        """Nothing was expected."""

    @property
    def first_block(self) -> int:
        """-1: blocks cannot be told apart."""
        return -1

    @property
    def total(self) -> Array:
        """Weighted sum over all blocks: packed Gram matrix and riders."""
        total: Array = self._sums[0].copy()
        return total

    def revise(self, update: Callable[[Array], Array]) -> None:
        """Change what was summed: ``update`` takes sums (2, 190 + riders) to their new values."""
        self._sums = update(self._sums)

    def push(self, block: int, gram: Array) -> None:
        """Take in a block: packed Gram matrix (190,), then the riders; its number does not matter."""
        self._sums = self._factors * self._sums + gram

    def push_early(self, block: int, gram: Array) -> None:
        """Nothing: it would have faded."""

    def review(self, model: InertiaModel, is_coherent: bool = False) -> None:
        """Remember the estimate, to stay there in directions that are not going to show."""
        information = self.information(model)
        estimate = np.linalg.solve(information.matrix, information.vector)
        # Slowly, because neighbouring estimates come from the same data: those must not count again and again.
        self._anchor = self._anchor + (1.0 - self._factor) * (estimate - self._anchor)

    def accept(self, block: int, model: InertiaModel) -> None:
        """Nothing: older blocks fade by themselves."""

    def forget_before(self, block: int) -> None:
        """Nothing: older blocks fade by themselves."""

    def forget_since(self, block: int) -> None:
        """Nothing: what they spoil fades with time."""

    def forget_borders_before(self, block: int) -> None:
        """Nothing: there are none."""

    def information(self, model: InertiaModel) -> InertiaInformation:
        """Of all blocks with their weights, and the floor."""
        weighted, squares = self._sums[:, :GRAM_SIZE]
        information = model.information(weighted)
        if not weighted.any():
            return _with_prior(information, self._floor, self._anchor)
        spread = model.information(squares).score_covariance
        basis, dual, shares = signal_directions(information.matrix, information.uncompensated, _SHOWN)
        shown = replace(
            information,
            matrix=(dual.T * shares) @ dual,
            vector=dual.T @ (basis @ information.vector),
            score_covariance=dual.T @ (basis @ spread @ basis.T) @ dual,
        )
        return _with_prior(shown, self._floor, self._anchor)


def _with_prior(information: InertiaInformation, prior: Array, mean: Array) -> InertiaInformation:
    """Added: that the unknowns are ``mean`` (u,) with the information ``prior`` (u, u)."""
    return replace(
        information,
        matrix=information.matrix + prior,
        vector=information.vector + prior @ mean,
        uncompensated=information.uncompensated + prior,
        score_covariance=information.score_covariance + prior,
    )
