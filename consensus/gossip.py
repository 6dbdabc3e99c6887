"""Gossip about the team, forwarded between neighbours: who is in it, who is linked with whom, and who is ready.

No robot is told the team's size or the graph. Each robot tells its neighbours its own link state; all hand on what
is new. A message carries what changed since the last one, the first heard first, and one older record in turn, so that
a lost message is made up for. What does not fit into ``PER_MESSAGE`` records follows with the next: the size of
messages does not grow with the team. Should somebody have a record wrong, it wins over the right one everywhere, or
nowhere; when the robot hears it, it tells its own anew, as if it had started again, for others have believed it.
Records are kept and handed on of robots only that someone known names as a neighbour, beginning with this robot: who
makes up robots fills no table with them, and keeps no room from true ones.

The **team** is all robots that hold the load. Whenever one of them starts again with an empty memory, lets go or takes
hold, it is another team, and all of its robots have to be ready for that one.
"""

from __future__ import annotations

import zlib
from collections import deque
from collections.abc import Iterable
from itertools import islice

from msgspec.structs import replace

from coheft.consensus.graph import distances
from coheft.wire.messages.size import PER_MESSAGE
from coheft.wire.messages.structs import LinkState
from coheft.wire.scenario.schema import MAX_ROBOTS

_WAITING = 64
"""Records of so many robots wait for being named: they may have overtaken the record that does so."""


class Gossip:
    """One agent's knowledge of the team.

    Args:
        name: Its own name.
        neighbours: Its neighbours' names.
        incarnation: Larger than that of any agent of the same name before.
    """

    def __init__(self, name: str, neighbours: Iterable[str], incarnation: int = 0) -> None:
        self.name = name
        self.records = {name: LinkState(name, 0, tuple(sorted(neighbours)), incarnation=incarnation)}
        self._waiting: dict[str, LinkState] = {}
        self._news = dict.fromkeys([name])
        self._turn = 0
        self._look_at_members()

    def hear(self, records: Iterable[LinkState]) -> None:
        """Process forwarded records; the newest record of each robot wins.

        No robot is told about itself: what is wrong, and would win, is answered.
        """
        heard, are_members_same = False, True
        for record in records:
            known = self.records.get(record.robot)
            if known is not None and not is_newer(record, known):
                continue
            if record.robot == self.name:
                self._tell(replace(self.own, incarnation=record.incarnation + 1, sequence=0))
                continue
            if record.robot not in self._named or (known is None and len(self.records) >= MAX_ROBOTS):
                self._let_wait(record)
                continue
            self.records[record.robot] = record
            self._news[record.robot] = None
            if record.robot in self.own.neighbours and (known is None or record.incarnation > known.incarnation):
                self._news = dict.fromkeys(self.records)  # it knows nothing yet
            heard = True
            are_members_same &= known is not None and _membership(known) == _membership(record)
        if not are_members_same:
            self._look_at_members()
        elif heard:
            self._look_at_readiness()

    def _let_wait(self, record: LinkState) -> None:
        """Keep what no one known has named so far; of too many, the first ones give way."""
        waiting = self._waiting.pop(record.robot, None)
        self._waiting[record.robot] = record if waiting is None or is_newer(record, waiting) else waiting
        if len(self._waiting) > _WAITING:
            del self._waiting[next(iter(self._waiting))]

    @property
    def own(self) -> LinkState:
        """What it tells about itself."""
        return self.records[self.name]

    @property
    def is_ready(self) -> bool:
        """Whether this robot has told the present team that it is ready."""
        return self.own.ready_block >= 0 and self.own.team == self.membership

    def announce_ready(self, block: int) -> None:
        """Tell all robots that this one can take part in the present team's sums from ``block`` on."""
        self._tell(replace(self.own, ready_block=block, team=self.membership))

    def announce_holding(self, holding: bool, since: int) -> None:
        """Tell every robot that this robot takes hold of the load, or lets go of it, at block ``since``."""
        self._tell(replace(self.own, holding=holding, since=since, ready_block=-1))

    def _tell(self, record: LinkState) -> None:
        is_member_same = _membership(record) == _membership(self.own)
        self.records[self.name] = replace(record, sequence=record.sequence + 1)
        self._news[self.name] = None
        if is_member_same:
            self._look_at_readiness()
        else:
            self._look_at_members()

    def news(self) -> list[LinkState]:
        """Records for the next message to the neighbours."""
        self._turn = (self._turn + 1) % len(self._names)
        told = {self._names[self._turn], *islice(self._news, PER_MESSAGE - 1)}
        for name in told:
            self._news.pop(name, None)
        return [self.records[name] for name in sorted(told)]

    @property
    def changed_at(self) -> int:
        """The newest block at which somebody has taken hold or let go."""
        return max(self.records[name].since for name in self._named & self.records.keys())

    def unknown(self) -> list[str]:
        """Robots that were named as neighbours, but from which no record has arrived."""
        return sorted(self._named - self.records.keys())

    def _look_who_is_named(self) -> None:
        """This robot, whom it names as a neighbour, whom these do, and so on, nearest first: others have to wait."""
        heard = {**self._waiting, **self.records}
        self._named, left = {self.name}, deque([self.name])
        records: dict[str, LinkState] = {}
        while left and len(records) < MAX_ROBOTS:
            name = left.popleft()
            if name in heard:
                records[name] = heard.pop(name)
                new = [other for other in records[name].neighbours if other not in self._named]
                self._named.update(new)
                left += new
        news = [*self._news, *(name for name in records if name not in self.records)]
        self._news = dict.fromkeys(name for name in news if name in records)
        self.records, self._names = records, sorted(records)
        self._waiting = dict(list(heard.items())[-_WAITING:])

    def _look_at_members(self) -> None:
        """Who is there and who talks with whom may have changed."""
        self.graph, self.membership = None, 0
        self._look_who_is_named()
        if not self.unknown():
            members = {name: self.records[name] for name in sorted(self._named) if self.records[name].holding}
            graph = {
                name: tuple(o for o in record.neighbours if o in members and name in members[o].neighbours)
                for name, record in members.items()
            }
            if len(graph) > 1 and len(distances(graph, min(graph))) == len(graph):
                self.graph = graph
                self.membership = zlib.crc32(repr(self._identity()).encode())
        self._look_at_readiness()

    def _look_at_readiness(self) -> None:
        self.start_block = None
        members = [self.records[name] for name in self.graph or ()]
        if members and all(r.ready_block >= 0 and r.team == self.membership for r in members):
            self.start_block = max(self.changed_at, *(record.ready_block for record in members))

    def _identity(self) -> list[tuple[str, int, int]]:
        members = (self.records[name] for name in self.graph or ())
        return [(member.robot, member.incarnation, member.since) for member in members]

    graph: dict[str, tuple[str, ...]] | None
    """The team's graph; None while somebody named as a neighbour has not been heard of, if it is not connected, or if
    only one robot holds the load."""
    membership: int
    """Number of the present members; 0 while the graph is unknown."""
    start_block: int | None
    """The block at which every robot is ready, the same for all agents; None while somebody is not."""


def is_newer(record: LinkState, known: LinkState) -> bool:
    """Whether one record of a robot replaces another; of two that should be the same, every robot takes the same."""
    age, known_age = (record.incarnation, record.sequence), (known.incarnation, known.sequence)
    return age > known_age or (age == known_age and record != known and repr(record) > repr(known))


def _membership(record: LinkState) -> tuple[object, ...]:
    """What of a record says who is in the team, and where."""
    return record.incarnation, record.holding, record.since, record.neighbours
