"""One robot's view of its team while that does not change: rows in transit, session, and handover to newcomers.

every row that is complete goes to the session, even if an earlier one is not complete yet
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from coheft.agents.efficient.exchange import Exchange
from coheft.agents.efficient.handover import CHANNEL, decode, encode
from coheft.agents.efficient.row_times import OwnRows, RowTimes
from coheft.agents.efficient.session import Session
from coheft.agents.efficient.settings import Guards, fit_settings
from coheft.agents.efficient.stages import Stage
from coheft.agents.estimator import Channels, RowSigner
from coheft.consensus.graph import diameter
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.chapter import Prior
from coheft.estimation.moments.unknowns import Unknowns
from coheft.wire.config import AgentConfig
from coheft.wire.messages.size import MOST_HANDED_OVER

if TYPE_CHECKING:  # not loaded in the open profile
    from coheft.agents.efficient.seals import Seals

_TIMES_SENT = 2
"""A new robot is sent the prior in so many messages, in case one is lost."""


class Team:
    """One robot's view of its team.

    Args:
        identities: Name, incarnation and first block of each robot.
        membership: Number of the team.
        graph: Neighbours of each robot.
        start: First block in which all robots hold the load.
        config: Configuration of this robot.
        guards: Thresholds and times.
        signer: Signs rows, None if rows are not signed.

    Attributes:
        indices: Index of each robot by its name, incarnation and first block.
        names: Names of the robots.
        own: Index of this robot.
        times: Times of rows.
        settings: Settings of fits.
        exchange: Rows in transit.
        session: Estimation from complete rows.
        start: First block in which all robots hold the load.
        noticed: Block in which each load change was noticed.
        noticed_slips: Blocks in which each slip was noticed, and was distinguished from a load change.
        newest: Newest block of which a row was processed; the one before ``start`` if there is none yet.
    """

    def __init__(
        self,
        identities: list[tuple[str, int, int]],
        membership: int,
        graph: Mapping[str, tuple[str, ...]],
        start: int,
        config: AgentConfig,
        guards: Guards,
        signer: RowSigner | None = None,
    ) -> None:
        self.indices = {identity: index for index, identity in enumerate(identities)}
        self.names = [name for name, _, _ in identities]
        self.own, hops = self.names.index(config.name), diameter(graph)
        self.times = times = RowTimes.of_team(len(identities), config.block, config.rate)
        self.settings, self._guards = fit_settings(config, self.names), guards
        errors, noise = self.settings.errors, config.sensors_of(config.name).noise
        self._own_rows = OwnRows(times, noise.gyro**2, config.rate, errors)
        self._waits = max(2, config.blocks(guards.waiting)) + times.spanned - 1
        self._oldest = self._waits + hops + config.blocks(guards.outdated)
        self._seals: Seals | None = None
        if signer is None:
            self.exchange = Exchange(membership, len(identities), self.own, hops, times, errors.row_size)
        else:
            from coheft.agents.efficient.seals import Seals, SealTimes

            seal_times = SealTimes.of_team(len(identities), hops, times, config, guards)
            window = seal_times.window(times)
            self.exchange = Exchange(membership, len(identities), self.own, hops, times, errors.row_size, window)
            first = times.begun_from(start)
            self._seals = Seals(self.names, self.own, first, self.exchange, times, seal_times, signer)
        self._prior: tuple[Prior, int] | None = None
        self._newcomers = dict[str, int]()
        self.start, self.newest, self._index = start, start - 1, start
        self._taken_at = start + hops  # block in which the newest row was taken
        self._unclear_since: int | None = None  # block in which a change was noticed whose cause is not known yet
        self._begin_session(None, self.settings.anchor)

    def begin(self, prior: Prior, anchor: int, newcomers: Sequence[str] = ()) -> None:
        """Start the session from a prior, which newcomers are sent when their first message arrives.

        Not if rows are signed: what a neighbour has concluded from them is not.
        """
        self._prior = prior, anchor
        is_sent = self._seals is None and Unknowns(len(self.names), self.settings.errors).size <= MOST_HANDED_OVER
        self._newcomers = dict.fromkeys(newcomers, _TIMES_SENT) if is_sent else {}
        self._begin_session(prior, anchor)

    def _begin_session(self, prior: Prior | None, anchor: int) -> None:
        self.session = Session(len(self.names), self.own, self.settings, self._guards, prior, anchor)
        self._next, self._taken = self.times.begun_from(self.start), set[int]()
        self.noticed: list[int] = []
        self.noticed_slips: list[tuple[int, int]] = []

    def adopt(self, channels: Channels) -> None:
        """Start from the prior in a neighbour's message, if this robot knows nothing yet and rows are not signed."""
        if self._seals is not None or CHANNEL not in channels:
            return
        if self._prior is None and self.session.stage is Stage.GATHERING:
            found = decode(channels[CHANNEL], self.exchange.team, len(self.names), self.settings)
            if found is not None:
                self.begin(*found, self.names)

    def welcomes(self, name: str) -> bool:
        """Whether the neighbour whose message has just arrived has to be sent the prior."""
        times = self._newcomers.pop(name, 0)
        if times > 1:
            self._newcomers[name] = times - 1
        return times > 0

    def known(self) -> Channels:
        """The channel with the prior for newcomers, empty if there is none."""
        return {} if self._prior is None else {CHANNEL: encode(self.exchange.team, *self._prior)}

    def enter(self, index: int, samples: Array) -> None:
        """Cut a block of this robot's own samples (B, 15) into rows, and send them."""
        for number, row in self._own_rows.add(index, samples):
            self.exchange.add_own(number, row)
            if self._seals is not None:
                self._seals.seal(number)

    def receive_seals(self, channels: Channels, index: int) -> None:
        """Process the seals in a neighbour's message."""
        if self._seals is not None:
            self._seals.receive(channels, index)

    def seal_channels(self) -> dict[str, Any]:
        """The channel with seals for neighbours, empty if rows are not signed."""
        return {} if self._seals is None else self._seals.channels()

    def refused(self) -> list[str]:
        """Return what has been refused since the last call, in words."""
        return [] if self._seals is None else self._seals.refused()

    def _check_seals(self, index: int) -> None:
        """Remove rows that are not those that their robots have signed."""
        first = None if self._seals is None else self._seals.check(index)
        if first is not None:
            self.session.take_back(first)
            self._taken = {number for number in self._taken if number < first}
            self._next = min(self._next, first)
            self.newest = min(self.newest, self.times.first_block(first) - 1)

    def look_closely_after(self, index: int) -> None:
        """Pass on load changes that other robots have reported up to this block."""
        self.session.look_closely_after(self.exchange.news_at, self.times.begun_from(index))

    def take(self, index: int) -> None:
        """Process all rows that are complete by now, even if an earlier one is not."""
        self._index = index
        self._check_seals(index)
        for number in range(self._next, self.times.complete(index)):
            row = None if number in self._taken else self.exchange.complete(number)
            if row is not None and (self._seals is None or self._seals.may_use(number)):
                if self._seals is not None:
                    self._seals.note_use(number)
                self.session.take(number, row)
                self._taken.add(number)
                if self.times.last_block(number) > self.newest:
                    self.newest, self._taken_at = self.times.last_block(number), index
        session = self.session
        if self._unclear_since is None:  # so that a slip that is named in the block in which it shows has a time
            self._unclear_since = index
        del self.noticed[len(session.causes.changes) :], self.noticed_slips[len(session.causes.slips) :]
        self.noticed += [index] * (len(session.causes.changes) - len(self.noticed))
        self.noticed_slips += [(self._unclear_since, index)] * (len(session.causes.slips) - len(self.noticed_slips))
        if session.contradicting is None and not session.causes.is_open:
            self._unclear_since = None
        oldest = self.times.begun_from(index - self.exchange.window)
        while self._next in self._taken or self._next < oldest:
            self._taken.discard(self._next)
            self._next += 1

    def disputed(self, blocks: int) -> list[str]:
        """Robots of which two different rows with one number arrived within the last ``blocks`` blocks."""
        found = self.exchange.disputed.items()
        return [self.names[robot] for robot, block in sorted(found) if self._index - block < blocks]

    def missing(self) -> list[str]:
        """Robots whose rows have been missing for too long; empty if there is none."""
        if self._index - self._taken_at <= self._waits and self._index - self.newest <= self._oldest:
            return []
        return [self.names[robot] for robot in self.exchange.missing(self.times.begun_from(self.newest + 1))]
