"""What everybody should know, handed on from neighbour to neighbour: who is there, who talks with whom, who is ready.

Nobody is told the team's size or the graph. Each robot tells its neighbours its own link state; everyone hands on what
is new. A message carries what changed since the last one, and one older record in turn, so that a lost message is made
up for and the size of messages does not grow with the team.
"""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from coheft.estimation.spatial import Pose
from coheft.wire.messages import LinkState


class Gossip:
    """One agent's knowledge of the team.

    Args:
        name: Its own name.
        neighbours: Its neighbours' names.
    """

    def __init__(self, name: str, neighbours: Iterable[str]) -> None:
        self.name = name
        self.records = {name: LinkState(name, 0, tuple(sorted(neighbours)))}
        self._news = {name}
        self._turn = 0

    def hear(self, records: Iterable[LinkState]) -> None:
        """Take in what a neighbour handed on; the newest record of each robot wins. Nobody is told about itself."""
        for record in records:
            known = self.records.get(record.robot)
            if record.robot != self.name and (known is None or record.sequence > known.sequence):
                self.records[record.robot] = record
                self._news.add(record.robot)

    def announce_ready(self, block: int, pose: Pose | None = None) -> None:
        """Tell everybody that this robot can take part in the network's sums from ``block`` on, and its pose."""
        own = self.records[self.name]
        numbers = () if pose is None else tuple(pose.numbers().tolist())
        self.records[self.name] = msgspec.structs.replace(
            own, sequence=own.sequence + 1, ready_block=block, pose=numbers
        )
        self._news.add(self.name)

    def news(self) -> list[LinkState]:
        """Records for the next message to the neighbours."""
        names = sorted(self.records)
        self._turn = (self._turn + 1) % len(names)
        told = self._news | {names[self._turn]}
        self._news = set()
        return [self.records[name] for name in sorted(told)]

    def pose(self, name: str) -> Pose | None:
        """What a robot has told of its pose, None if nothing."""
        numbers = self.records[name].pose
        return Pose.of_numbers(numbers) if numbers else None

    @property
    def graph(self) -> dict[str, tuple[str, ...]] | None:
        """The whole graph, or None while somebody named as a neighbour has not been heard of."""
        graph = {name: self.records[name].neighbours for name in sorted(self.records)}
        closed = all(other in graph for others in graph.values() for other in others)
        return graph if closed else None

    @property
    def start_block(self) -> int | None:
        """The block at which everybody is ready, the same for all agents; None while somebody is not."""
        if self.graph is None:
            return None
        blocks = [record.ready_block for record in self.records.values()]
        return None if min(blocks) < 0 else max(blocks)
