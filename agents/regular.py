"""Tasks that are due at regular numbers of blocks."""


class Regular:
    """Schedule of a regular task: it is due at blocks whose number is a multiple of ``every``, the same for all agents.

    If such a block is skipped, because measurements came faster than the agent could process them, it is due at the
    next one.
    """

    def __init__(self, every: int) -> None:
        self._every = every
        self._last: int | None = None

    def is_due(self, block: int) -> bool:
        """Whether the task is due at a block; to be called for every block that the agent processes, in order."""
        last, self._last = block - 1 if self._last is None else self._last, block
        return block // self._every > last // self._every
