"""Gossip about the team, forwarded between neighbours: its members, their links, and whether they are ready.

No robot is given the team's size or the graph. Each robot sends its neighbours its own link state, and all forward new
records. A message holds the records that changed since the last one, in order of arrival, and one older record in
rotation, which makes up for lost messages. Records beyond ``PER_MESSAGE`` follow in the next messages, so that the size
of messages does not grow with the team. If a robot receives a wrong record about itself that would replace its own, it
sends its own with a larger incarnation, as after a restart, because others have accepted the wrong one. A robot keeps
and forwards records only of robots that are named as neighbours, directly or through others, starting from itself:
records of invented robots cannot fill its table.

The **team** is the set of robots that hold the load. When one of them restarts, releases the load or grasps it, the
team is a new one, and all of its robots have to announce again that they are ready.
"""

import zlib
from collections import deque
from collections.abc import Iterable
from itertools import islice

from msgspec.structs import replace

from coheft.consensus.graph import distances
from coheft.wire.messages.limits import PER_MESSAGE
from coheft.wire.messages.structs import LinkState
from coheft.wire.scenario.schema import MAX_ROBOTS

_MAX_DEFERRED = 64
"""Number of records kept of robots that are not named yet: they may arrive before the record that names them."""


class Gossip:
    """One agent's knowledge of the team.

    Args:
        name: This agent's name.
        neighbours: Its neighbours' names.
        incarnation: A number larger than that of any earlier agent of the same name.
    """

    def __init__(self, name: str, neighbours: Iterable[str], incarnation: int = 0) -> None:
        self.name = name
        self.records = {name: LinkState(name, 0, tuple(sorted(neighbours)), incarnation=incarnation)}
        self._deferred: dict[str, LinkState] = {}
        self._unsent = dict.fromkeys([name])
        self._turn = 0
        self._update_members()

    def hear(self, records: Iterable[LinkState]) -> None:
        """Process forwarded records; the newest record of each robot wins.

        A record about this robot itself is never used: if it would win, this robot publishes a newer one.
        """
        has_news, are_members_same = False, True
        for record in records:
            known = self.records.get(record.robot)
            if known is not None and not is_newer(record, known):
                continue
            if record.robot == self.name:
                self._publish(replace(self.own, incarnation=record.incarnation + 1, sequence=0))
                continue
            if record.robot not in self._named or (known is None and len(self.records) >= MAX_ROBOTS):
                self._defer(record)
                continue
            self.records[record.robot] = record
            self._unsent[record.robot] = None
            if record.robot in self.own.neighbours and (known is None or record.incarnation > known.incarnation):
                self._unsent = dict.fromkeys(self.records)  # the neighbour has restarted and knows nothing yet
            has_news = True
            are_members_same &= known is not None and _membership(known) == _membership(record)
        if not are_members_same:
            self._update_members()
        elif has_news:
            self._update_start_block()

    def _defer(self, record: LinkState) -> None:
        """Keep a record of a robot that is not named yet; if there are too many, drop the oldest."""
        waiting = self._deferred.pop(record.robot, None)
        self._deferred[record.robot] = record if waiting is None or is_newer(record, waiting) else waiting
        if len(self._deferred) > _MAX_DEFERRED:
            del self._deferred[next(iter(self._deferred))]

    @property
    def own(self) -> LinkState:
        """The link state that this robot sends about itself."""
        return self.records[self.name]

    @property
    def is_ready(self) -> bool:
        """Whether this robot has announced to the present team that it is ready."""
        return self.own.ready_block >= 0 and self.own.team == self.membership

    def announce_ready(self, block: int) -> None:
        """Announce that this robot can take part in the present team's sums from ``block`` on."""
        self._publish(replace(self.own, ready_block=block, team=self.membership))

    def announce_holding(self, holding: bool, since: int) -> None:
        """Announce that this robot grasps the load, or releases it, at block ``since``."""
        self._publish(replace(self.own, holding=holding, since=since, ready_block=-1))

    def _publish(self, record: LinkState) -> None:
        is_member_same = _membership(record) == _membership(self.own)
        self.records[self.name] = replace(record, sequence=record.sequence + 1)
        self._unsent[self.name] = None
        if is_member_same:
            self._update_start_block()
        else:
            self._update_members()

    def news(self) -> list[LinkState]:
        """Return the records for the next message to the neighbours."""
        self._turn = (self._turn + 1) % len(self._names)
        sent = {self._names[self._turn], *islice(self._unsent, PER_MESSAGE - 1)}
        for name in sent:
            self._unsent.pop(name, None)
        return [self.records[name] for name in sorted(sent)]

    @property
    def changed_at(self) -> int:
        """The newest block at which a robot has grasped or released the load."""
        return max(self.records[name].since for name in self._named & self.records.keys())

    def unknown(self) -> list[str]:
        """Return robots that are named as neighbours, but from which no record has arrived."""
        return sorted(self._named - self.records.keys())

    def _find_named(self) -> None:
        """Find the robots that are named: this one, its neighbours, their neighbours, and so on; defer records of
        others.
        """
        received = {**self._deferred, **self.records}
        self._named, left = {self.name}, deque([self.name])
        records: dict[str, LinkState] = {}
        while left and len(records) < MAX_ROBOTS:
            name = left.popleft()
            if name in received:
                records[name] = received.pop(name)
                new = [other for other in records[name].neighbours if other not in self._named]
                self._named.update(new)
                left += new
        news = [*self._unsent, *(name for name in records if name not in self.records)]
        self._unsent = dict.fromkeys(name for name in news if name in records)
        self.records, self._names = records, sorted(records)
        self._deferred = dict(list(received.items())[-_MAX_DEFERRED:])

    def _update_members(self) -> None:
        """Update members and graph, after records of members have changed."""
        self.graph, self.membership = None, 0
        self._find_named()
        if not self.unknown():
            members = {name: self.records[name] for name in sorted(self._named) if self.records[name].holding}
            graph = {
                name: tuple(o for o in record.neighbours if o in members and name in members[o].neighbours)
                for name, record in members.items()
            }
            if len(graph) > 1 and len(distances(graph, min(graph))) == len(graph):
                self.graph = graph
                self.membership = zlib.crc32(repr(self._identity()).encode())
        self._update_start_block()

    def _update_start_block(self) -> None:
        self.start_block = None
        members = [self.records[name] for name in self.graph or ()]
        if members and all(r.ready_block >= 0 and r.team == self.membership for r in members):
            self.start_block = max(self.changed_at, *(record.ready_block for record in members))

    def _identity(self) -> list[tuple[str, int, int]]:
        members = (self.records[name] for name in self.graph or ())
        return [(member.robot, member.incarnation, member.since) for member in members]

    graph: dict[str, tuple[str, ...]] | None
    """The team's graph. None while a record of a named robot is missing, if the graph is not connected, or if only one
    robot holds the load."""
    membership: int
    """Checksum that identifies the present members; 0 while the graph is unknown."""
    start_block: int | None
    """The block at which every robot is ready, the same for all agents; None while a robot is not ready."""


def is_newer(record: LinkState, known: LinkState) -> bool:
    """Whether one record of a robot replaces another; of two with equal numbers, all robots select the same one."""
    age, known_age = (record.incarnation, record.sequence), (known.incarnation, known.sequence)
    return age > known_age or (age == known_age and record != known and repr(record) > repr(known))


def _membership(record: LinkState) -> tuple[object, ...]:
    """Return the fields of a record that determine the members and the graph."""
    return record.incarnation, record.holding, record.since, record.neighbours
