"""Simulated imperfections of the links between neighbours."""

from typing import Annotated

from msgspec import Meta

from coheft.wire.scenario.section import Section

_UpToOne = Annotated[float, Meta(ge=0, le=1)]


class LinkQuality(Section, frozen=True):
    """Loss and delay of the messages that a robot receives over a link.

    Attributes:
        loss: Share of messages that are lost.
        delay: Delay of every message [s]. A message that is late by less than a block is in time.
        jitter: Largest additional delay [s], drawn for each message; messages may overtake each other.
    """

    loss: _UpToOne = 0.0
    delay: _UpToOne = 0.0
    jitter: _UpToOne = 0.0

    @property
    def is_ideal(self) -> bool:
        """Whether all messages arrive in time."""
        return not (self.loss or self.delay or self.jitter)

    @property
    def in_words(self) -> str:
        """What happens to the messages."""
        late = f"{self.delay:g} to {self.delay + self.jitter:g}" if self.jitter else f"{self.delay:g}"
        if not self.loss:
            return f"{late} s late"
        lost = f"{100 * self.loss:g} % lost"
        return f"{lost}, others {late} s late" if self.delay or self.jitter else lost
