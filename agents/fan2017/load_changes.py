"""Load changes that a robot has noticed, as it reports them."""

from __future__ import annotations

from coheft.wire.config import AgentConfig
from coheft.wire.messages.structs import LoadChangeNotice

_NEWEST = 32
"""So many of the newest are remembered."""


class LoadChanges:
    """Those of one robot, for as long as it lives.

    Args:
        config: Its settings.
    """

    def __init__(self, config: AgentConfig) -> None:
        self._config = config
        self._noticed_block = -1
        self._notices: tuple[LoadChangeNotice, ...] = ()

    @property
    def notices(self) -> tuple[LoadChangeNotice, ...]:
        """The newest ones, oldest first."""
        return self._notices

    def notice(self, changed_at: int, index: int, within: int) -> None:
        """The load has changed, as this robot or another one has found.

        Args:
            changed_at: The first block with the new load.
            index: The present block.
            within: Blocks in which every robot hears of a change: if one was noticed since, this is the same one, found
                by somebody else who places it a bit later.
        """
        noticed_at = self._config.start_of(index + 1)
        kept = self._notices
        if kept and index - self._noticed_block <= within:
            noticed_at, kept = kept[-1].noticed_at, kept[:-1]
        else:
            self._noticed_block = index
        self._notices = (*kept, LoadChangeNotice(noticed_at, self._config.start_of(changed_at)))[-_NEWEST:]
