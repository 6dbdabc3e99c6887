"""One robot's view of its team while that is what it is: its rows under way, its session, and what newcomers are told.

rows of all robots that are complete -> session, also those behind some that are not
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from agents.efficient.exchange import Exchange
from agents.efficient.handover import CHANNEL, heard, told
from agents.efficient.session import Session
from agents.efficient.settings import Guards
from agents.efficient.stages import Stage
from agents.estimator import Channels
from coheft.estimation.moments.chapter import Prior
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.unknowns import Unknowns
from coheft.wire.message_size import MOST_TOLD
from consensus.graph import diameter

_TOLD = 2
"""What is known is told twice to a robot that is new."""


class Team:
    """One robot's view of its team.

    Args:
        lives: Of each robot its name, and since when it is what it is.
        own: Place of this one.
        membership: Number of the team.
        graph: Of the team.
        start: First block in which all of them hold the load.
        parts: Rows of a block.
        waits: So many blocks longer than it takes to get here a row of the whole team is waited for.
        settings: Of fits.
        guards: Thresholds and times.

    Attributes:
        places: Place of each robot by its name and life.
        names: Of its robots.
        own: Place of this one.
        start: First block in which all of them hold the load.
        noticed: Block in which each change of the load was noticed.
        newest: Newest block of which a row was taken, -1 if none.
    """

    def __init__(
        self,
        lives: list[tuple[str, int, int]],
        own: int,
        membership: int,
        graph: Mapping[str, tuple[str, ...]],
        start: int,
        parts: int,
        waits: int,
        settings: FitSettings,
        guards: Guards,
    ) -> None:
        self.places = {life: place for place, life in enumerate(lives)}
        self.names, self.own = [name for name, _, _ in lives], own
        hops = diameter(graph)
        self._parts, self._waits = parts, hops + waits
        self.exchange = Exchange(membership, len(lives), own, hops, parts)
        self._settings, self._guards = settings, guards
        self._prior: tuple[Prior, int] | None = None
        self._newcomers = dict[str, int]()
        self.session = Session(len(lives), own, settings, guards)
        self._next, self._taken = start * parts, set[int]()
        self.start, self.newest, self._index = start, start - 1, start
        self.noticed: list[int] = []

    def begin(self, prior: Prior, anchor: int, newcomers: Sequence[str] = ()) -> None:
        """Go on from what is known, which robots that are new in the team are told when they are first heard of."""
        self._prior = prior, anchor
        is_told = Unknowns(len(self.names), self._settings.errors).size <= MOST_TOLD
        self._newcomers = dict.fromkeys(newcomers, _TOLD) if is_told else {}
        self.session = Session(len(self.names), self.own, self._settings, self._guards, prior, anchor)
        self._next, self._taken, self.noticed = self.start * self._parts, set(), []

    def adopt(self, channels: Channels) -> None:
        """Begin with what a neighbour knows, if this robot knows nothing."""
        if CHANNEL in channels and self._prior is None and self.session.stage is Stage.GATHERING:
            found = heard(channels[CHANNEL], self.exchange.team, len(self.names), self._settings)
            if found is not None:
                self.begin(*found, self.names)

    def welcomes(self, name: str) -> bool:
        """Whether a neighbour that has just been heard has to be told what is known."""
        times = self._newcomers.pop(name, 0)
        if times > 1:
            self._newcomers[name] = times - 1
        return times > 0

    def known(self) -> Channels:
        """What newcomers are told."""
        return {} if self._prior is None else {CHANNEL: told(self.exchange.team, *self._prior)}

    def take(self, index: int) -> None:
        """All rows that are complete by now, also those behind some that are not."""
        self._index = index
        for number in range(self._next, (index + 1) * self._parts):
            row = None if number in self._taken else self.exchange.complete(number)
            if row is not None:
                self.session.take(number, row)
                self._taken.add(number)
                self.newest = max(self.newest, number // self._parts)
        self.noticed += [index] * (len(self.session.changes) - len(self.noticed))
        oldest = (index - self._waits) * self._parts
        while self._next in self._taken or self._next < oldest:
            self._taken.discard(self._next)
            self._next += 1

    def disputed(self, blocks: int) -> list[str]:
        """Robots of which different rows for one time have come within the last so many blocks."""
        found = self.exchange.disputed.items()
        return [self.names[robot] for robot, block in sorted(found) if self._index - block < blocks]

    def missing(self) -> list[str]:
        """Robots of which no rows have come for too long; empty if all is well."""
        if self._index - self.newest <= self._waits:
            return []
        return [self.names[robot] for robot in self.exchange.missing((self.newest + 1) * self._parts)]
