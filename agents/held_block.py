"""A block of sums that surprises waits for the next complete one: a load changes for longer than a glitch lasts."""

from __future__ import annotations

from dataclasses import dataclass

from coheft.estimation.registration import RegistrationMoments
from coheft.estimation.spatial import Array

_JUMP = 30.0
"""A block whose squared residuals are so many times what they should be is held until the next one has come."""


@dataclass(frozen=True, eq=False)
class Block:
    """What a complete sum says of the own pose, and of the load, see ``agents.load_moments``."""

    number: int
    pose: RegistrationMoments
    load: Array


class HeldBlock:
    """The one that waits, if any does."""

    def __init__(self) -> None:
        self._held: Block | None = None

    def drop(self) -> None:
        """What comes next has nothing to do with it."""
        self._held = None

    def admit(self, block: Block, surprise: float) -> tuple[Block, ...]:
        """What can be learned from now that a block has come, oldest first.

        Args:
            block: It.
            surprise: Mean square of its residuals over what it should be.
        """
        held, self._held = self._held, None
        if surprise <= _JUMP:
            return (block,)
        if held is None:
            self._held = block
            return ()
        return held, block
