"""Work that is due at regular numbers of blocks."""

from __future__ import annotations


class Regular:
    """Says when such work is due: at blocks whose number is a multiple, the same for all agents.

    Where blocks are skipped, because measurements came faster than the agent could step, it is due at the next one.

    Args:
        every: Blocks from one time to the next.
    """

    def __init__(self, every: int) -> None:
        self._every = every
        self._last: int | None = None

    def is_due(self, block: int) -> bool:
        """Whether it is, at a block; to be asked at every block that the agent steps for, in order."""
        last, self._last = block - 1 if self._last is None else self._last, block
        return block // self._every > last // self._every
