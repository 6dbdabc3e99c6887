"""Sums up a tree and down again: in each block, an edge carries one subtotal up and one total down.

An agent keeps its own value of a block until its children's subtotals of that block arrive. It delays the total so that
all agents output it in the same block. With the number of agents only these delays grow, not the messages.
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from coheft.consensus.schedule import TreeSchedule
from coheft.estimation.geometry.spatial import Array

_NO_VERSION = -1


@dataclass(frozen=True, eq=False)
class _Value:
    """Values (B, C) of a block, and the version number that all their summands share."""

    values: Array
    version: int


class TreeRounds:
    """One agent's share of the sums over a tree. See ``coheft.consensus.rounds.Rounds``; arguments as of
    ``make_rounds``.
    """

    def __init__(
        self,
        schedule: TreeSchedule,
        channel: str,
        name: str,
        neighbours: tuple[str, ...],
        samples: int,
        width: int,
        transports: Mapping[str, Array] | None = None,
    ) -> None:
        self._transports = transports or {}
        self._shape = (samples, width)
        self._up_channel, self._down_channel, self._versions_channel = (
            f"{channel}_{part}" for part in ("up", "down", "versions")
        )
        self._parent = schedule.parent.get(name)
        self._children = tuple(other for other in neighbours if schedule.parent.get(other) == name)
        depth, height = schedule.depth[name], schedule.height
        self._wait = height - depth
        # Own values without the children's subtotals, versions of blocks whose total has not arrived, and delayed
        # totals.
        self._waiting: deque[_Value | None] = deque([None] * self._wait, maxlen=self._wait)
        self._expected = deque([_NO_VERSION] * (height + depth), maxlen=height + depth)
        self._totals: deque[_Value | None] = deque([None] * self._wait, maxlen=self._wait)
        self._up: _Value | None = None
        self._down: _Value | None = None

    def advance(self, inbox: Mapping[str, Mapping[str, Array]]) -> Array | None:
        """See ``Rounds``."""
        if self._wait:
            self._up = self._with_children(self._waiting.pop(), inbox)
        expected = self._expected.pop()
        if self._parent is None:
            self._down = self._up
        else:
            self._down = self._received(inbox, self._parent, self._down_channel, 1, expected)
        total = self._down
        if self._wait:
            total = self._totals.pop()
            self._totals.appendleft(self._down)
        return None if total is None else total.values

    def _with_children(self, value: _Value | None, inbox: Mapping[str, Mapping[str, Array]]) -> _Value | None:
        """Return an own value plus the children's subtotals of the same block; None if one is missing."""
        for child in self._children:
            if value is None:
                return None
            subtotal = self._received(inbox, child, self._up_channel, 0, value.version)
            value = None if subtotal is None else _Value(value.values + subtotal.values, value.version)
        return value

    def _received(
        self, inbox: Mapping[str, Mapping[str, Array]], sender: str, name: str, place: int, version: int
    ) -> _Value | None:
        channels, transport = inbox.get(sender, {}), self._transports.get(sender)
        values, versions = channels.get(name), channels.get(self._versions_channel)
        if values is None or versions is None or values.shape != self._shape or versions.shape != (2,):
            return None
        if not versions[place] == version >= 0:
            return None
        return _Value(values if transport is None else values @ transport.T, version)

    def enter(self, values: Array | None, version: int = 0) -> None:
        """See ``Rounds``."""
        value = None if values is None else _Value(values, version)
        self._expected.appendleft(_NO_VERSION if value is None else version)
        if self._wait:
            self._waiting.appendleft(value)
        else:
            self._up = value

    def clear(self) -> None:
        """See ``Rounds``."""
        for under_way in (self._waiting, self._totals):
            under_way.extend([None] * self._wait)
        self._expected.extend([_NO_VERSION] * len(self._expected))
        self._up = self._down = None

    def fit(self, channels: Mapping[str, Array]) -> bool:
        """See ``Rounds``."""
        values = (channels.get(self._up_channel), channels.get(self._down_channel))
        versions = channels.get(self._versions_channel)
        return all(each is None or each.shape == self._shape for each in values) and (
            versions is None or versions.shape == (2,)
        )

    def channels(self) -> dict[str, Array]:
        """See ``Rounds``."""
        sent, versions = {}, np.full(2, float(_NO_VERSION))
        ways = (
            (self._up_channel, self._up, self._parent is not None),
            (self._down_channel, self._down, bool(self._children)),
        )
        for place, (name, value, is_of_use) in enumerate(ways):
            if value is not None and is_of_use:
                sent[name], versions[place] = value.values, value.version
        return {**sent, self._versions_channel: versions}
