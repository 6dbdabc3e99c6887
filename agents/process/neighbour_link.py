"""State of the link with one neighbour, its messages, and whether to wait for it."""

import math
from collections import deque

from coheft.wire.messages.structs import Hello, NeighbourMessage

SILENCE = 2.0
"""Time after which a neighbour is silent [s]. A running process sends more often, however long its steps take; it is
longer than Zenoh's lease."""
LONGEST_PAUSE = 64.0
"""Longest time between two attempts to renew a link [s]; the first one is ``SILENCE``."""
MOST_KEPT = 64
"""Number of messages that are kept for later steps; a neighbour that is further ahead does not keep pace."""


class NeighbourLink:
    """The link with one neighbour, dialled ``now`` [s].

    Attributes:
        name: The neighbour's name.
        is_linked: Whether the link is up.
        is_heard: Whether a message has arrived since it is up.
        hears_us: Whether the neighbour has confirmed that it receives this robot's messages.
        keeps_pace: Whether its message of the next block can be expected in time.
    """

    def __init__(self, name: str, now: float) -> None:
        self.name = name
        self.is_linked = False
        self.is_heard = False
        self.hears_us = False
        self.keeps_pace = False
        self._known: bool | None = None
        self._heard_at = -math.inf
        self._whole_at = -math.inf
        self._begun_at = now
        self._pause = SILENCE
        self._incarnation = -1
        self._messages: deque[NeighbourMessage] = deque(maxlen=MOST_KEPT)

    def note_presence(self, is_here: bool) -> None:
        """Note that the link is up, or lost."""
        self.is_linked = is_here
        if not is_here:
            self.is_heard = self.hears_us = self.keeps_pace = False

    @property
    def is_whole(self) -> bool:
        """Whether the link is up and works in both directions."""
        return self.is_linked and self.is_heard and self.hears_us

    def notice_silence(self, now: float) -> None:
        """Discard what is known about the link if the neighbour has been silent for too long; ``now`` in [s]."""
        if now - self._heard_at > SILENCE:
            self.is_heard = self.hears_us = self.keeps_pace = False

    def begin_anew(self, now: float) -> bool:
        """Whether to renew the link ``now`` [s], which then counts as renewed; after one in vain the pause doubles.

        A lost link is not left to recover by itself: it may come back without carrying messages.
        """
        if self.is_whole:
            self._pause, self._whole_at = SILENCE, now
            return False
        since = max(self._begun_at, self._whole_at) if self.is_linked else self._begun_at
        if now - since < self._pause:
            return False
        self._begun_at, self._pause = now, min(2.0 * self._pause, LONGEST_PAUSE)
        self.note_presence(False)
        return True

    def take_change(self) -> bool:
        """Whether the link was lost or restored since the last call; the first time that it is up is no change."""
        if self._known is None:
            self._known = True if self.is_linked else None
            return False
        has_changed = self._known != self.is_linked
        self._known = self.is_linked
        return has_changed

    def take_hello(self, hello: Hello, own_name: str, now: float) -> None:
        """Process the neighbour's hello; ``now`` in [s]."""
        self._incarnation = hello.incarnation  # replaces a larger one, which was an error
        self.is_heard, self._heard_at = True, now
        self.hears_us = own_name in hello.heard

    def take_message(self, message: NeighbourMessage, next_block: int, now: float) -> None:
        """Keep a message, received ``now`` [s], for its step; the next step is that of ``next_block``."""
        self._incarnation = max(self._incarnation, message.incarnation)
        self._messages.append(message)
        self.is_heard, self._heard_at = True, now
        self.keeps_pace = self.keeps_pace or self._can_be_of_use(message, next_block)

    def forget(self) -> None:
        """Discard the neighbour's messages, because no steps will use them."""
        self._messages.clear()
        self.keeps_pace = False

    def is_missing(self, block: int) -> bool:
        """Whether the step of a block should wait for this neighbour."""
        if not (self.is_linked and self.keeps_pace):
            return False
        return not any(self._can_be_of_use(message, block) for message in self._messages)

    def take_messages(self, block: int) -> list[NeighbourMessage]:
        """Return the messages for the step of a block, or before; messages for later steps are kept."""
        now: list[NeighbourMessage] = []
        later: list[NeighbourMessage] = []
        for message in self._messages:
            (later if self._can_be_of_use(message, block + 1) else now).append(message)
        self._messages = deque(later, MOST_KEPT)
        return now

    def _can_be_of_use(self, message: NeighbourMessage, block: int) -> bool:
        """Whether a message is the one that the step of a block needs, or of one of the next steps.

        A neighbour may skip blocks: once a later message has arrived, earlier ones will not. Messages from before the
        neighbour restarted are not used.
        """
        return message.incarnation == self._incarnation and block - 1 <= message.block < block - 1 + MOST_KEPT
