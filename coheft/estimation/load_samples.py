"""What holds the samples of the load that count: ``load_change`` has one kind of it, ``forgetting_window`` another."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from coheft.estimation.inertia import InertiaInformation, InertiaModel
from coheft.estimation.load_comparison import KnownLoad
from coheft.estimation.spatial import Array


class Memory(Protocol):
    """What holds the samples that count."""

    def push(self, block: int, gram: Array) -> None:
        """Take in a block: its number, larger than all before, and packed Gram matrix (190,), then the riders."""

    def push_early(self, block: int, gram: Array) -> None:
        """Take in a block from before all others: its number, smaller than all before, and moments."""

    @property
    def kept(self) -> float:
        """Share that is left of what counted before when a block comes."""

    @property
    def doubt(self) -> float:
        """How many times larger covariances are than those of samples that agree.

        Chi-square per degree of freedom (Birge 1932) where samples disagree by more than chance, but not enough to say
        that the load has changed; else 1.
        """

    @property
    def former(self) -> KnownLoad | None:
        """What the load may still be: it seems to have changed, but so it would if a sensor had been off since.

        Also what was expected, until it is clear whether it is that. None if the load is what the samples say.
        """

    def known_load(self, model: InertiaModel) -> KnownLoad | None:
        """What the load is, or was as long as it is not clear whether it has changed; None if that is not known."""

    def expect(self, load: KnownLoad) -> None:
        """Before there are samples: a former team knew the load as this, and samples will say whether it still is."""

    def reconsider(self) -> None:
        """The load that was expected is to be told from what samples say again, though it has seemed to be the same."""

    @property
    def first_block(self) -> int:
        """Number of the oldest block that counts, -1 if there is none or it cannot be told from others."""

    @property
    def total(self) -> Array:
        """Sum over all blocks that count: packed Gram matrix and riders."""

    def revise(self, update: Callable[[Array], Array]) -> None:
        """Change what was summed: ``update`` takes sums (k, 190 + riders) to their new values."""

    def review(self, model: InertiaModel, is_coherent: bool = False) -> int | None:
        """Look at what is remembered, and forget what belongs to another load.

        Returns:
            The first block of the present load, if a change was found.
        """

    def accept(self, block: int, model: InertiaModel) -> None:
        """Forget all blocks with smaller numbers: somebody else found a change."""

    def forget_before(self, block: int) -> None:
        """Forget all blocks with smaller numbers."""

    def forget_since(self, block: int) -> None:
        """Forget all blocks from this one on."""

    def forget_borders_before(self, block: int) -> None:
        """Keep all samples, but do not look for changes before this block any more."""

    def information(self, model: InertiaModel) -> InertiaInformation:
        """All that counts."""
