"""A neighbour of an agent's process: the state of its link, its messages, and whether to wait for it."""

from __future__ import annotations

import math
from collections import deque

from coheft.wire.messages.structs import Hello, NeighbourMessage

SILENCE = 2.0
"""A neighbour whose process runs is heard more often, however long its steps take [s]; longer than Zenoh's lease."""
LONGEST_PAUSE = 64.0
"""Between two attempts to begin the link with a neighbour anew, when they are in vain [s]; the first is ``SILENCE``."""
KEPT = 64
"""Messages that may wait for their step; a neighbour that is further ahead is not one to keep pace with."""


class NeighbourLink:
    """One neighbour.

    Args:
        name: Its name.
        now: Time at which its link is begun [s].

    Attributes:
        name: Its name.
        is_linked: Its link stands.
        is_heard: It has said something since.
        hears_us: It has said that it hears us.
        keeps_pace: Its message of the next block can be expected in time.
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
        self._messages: deque[NeighbourMessage] = deque(maxlen=KEPT)

    def note_presence(self, is_here: bool) -> None:
        """Its link is up now, or lost."""
        self.is_linked = is_here
        if not is_here:
            self.is_heard = self.hears_us = self.keeps_pace = False

    @property
    def is_whole(self) -> bool:
        """Its link is up, and works in both directions."""
        return self.is_linked and self.is_heard and self.hears_us

    def notice_silence(self, now: float) -> None:
        """It has not been heard of late: what it said before says nothing of its link. ``now`` in [s]."""
        if now - self._heard_at > SILENCE:
            self.is_heard = self.hears_us = self.keeps_pace = False

    def begin_anew(self, now: float) -> bool:
        """Whether to begin its link anew, which then counts as begun; in vain, each pause is twice the one before.

        A link that is gone is left at once: one that comes back by itself may stay mute.

        Args:
            now: Time [s].
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
        """Whether its link has gone, or come back, since this was asked; that it comes at first is no change."""
        if self._known is None:
            self._known = True if self.is_linked else None
            return False
        has_changed = self._known != self.is_linked
        self._known = self.is_linked
        return has_changed

    def take_hello(self, hello: Hello, own_name: str, now: float) -> None:
        """It is there, and may have started again; ``now`` in [s]."""
        self._incarnation = hello.incarnation  # a larger one that it has not was an error
        self.is_heard, self._heard_at = True, now
        self.hears_us = own_name in hello.heard

    def take_message(self, message: NeighbourMessage, next_block: int, now: float) -> None:
        """Keep a message for its step.

        Args:
            message: It.
            next_block: The block of the next step.
            now: Time [s].
        """
        self._incarnation = max(self._incarnation, message.incarnation)
        self._messages.append(message)
        self.is_heard, self._heard_at = True, now
        self.keeps_pace = self.keeps_pace or self._can_be_of_use(message, next_block)

    def forget(self) -> None:
        """Forget what it has said: there are no steps for it now."""
        self._messages.clear()
        self.keeps_pace = False

    def is_missing(self, block: int) -> bool:
        """Whether the step of a block should wait for it."""
        if not (self.is_linked and self.keeps_pace):
            return False
        return not any(self._can_be_of_use(message, block) for message in self._messages)

    def take_messages(self, block: int) -> list[NeighbourMessage]:
        """What it has said for the step of a block, or before; what is for later steps stays, however soon it came."""
        now: list[NeighbourMessage] = []
        later: list[NeighbourMessage] = []
        for message in self._messages:
            (later if self._can_be_of_use(message, block + 1) else now).append(message)
        self._messages = deque(later, KEPT)
        return now

    def _can_be_of_use(self, message: NeighbourMessage, block: int) -> bool:
        """Whether a message is the one that the step of a block needs, or of one of the next steps.

        A neighbour may skip blocks: when a later message is here, those before it will not come. What it said before it
        started again is of no use.
        """
        return message.incarnation == self._incarnation and block - 1 <= message.block < block - 1 + KEPT
