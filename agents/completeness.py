"""Whether a team's sums have been complete of late, so that a change of the load would have been noticed."""

from __future__ import annotations

from coheft.wire.config import AgentConfig

_PATIENCE = 0.25
"""After so long without a complete sum, the load may have changed unnoticed; and when sums are complete again, a change
in the meantime takes so long to be noticed [s]."""


class Completeness:
    """Follows the blocks whose sums were complete.

    Args:
        config: The agent's settings.
        rounds: Blocks from a sample's entering the sums to its leaving them.
        settling: For so many blocks after the first one something may be wrong without being noticed.

    Attributes:
        newest: The newest such block, -1 while there is none.
    """

    def __init__(self, config: AgentConfig, rounds: int, settling: int) -> None:
        self._config = config
        self._rounds = rounds
        self._patience = config.blocks(_PATIENCE)
        self._settling = settling
        self._resumed = self._settled = -1
        self.newest = -1

    def note(self, block: int) -> None:
        """The sums of a block are complete."""
        if self.newest < 0:
            self._resumed, self._settled = block, block + self._settling
        elif block > self.newest + self._patience:
            wait = self._patience if self.newest >= self._settled else max(self._patience, self._settling)
            self._resumed, self._settled = block, block + wait
        self.newest = block

    def gap(self, block: int) -> str | None:
        """Why the load may have changed unnoticed by now, the start of a block; None if it cannot have."""
        if block - 1 - self._rounds - self.newest <= self._patience:
            return None
        return f"no complete sum of the team since {self._config.start_of(self.newest + 1):.2f} s"

    @property
    def recent_gap(self) -> str | None:
        """Why it may have done so during the last gap, and not be noticed yet; None if it would have been."""
        if self.newest >= self._settled:
            return None
        return f"complete sums of the team again since {self._config.start_of(self._resumed):.2f} s only"
