"""Flooding of rows: a robot forwards each row that it receives for the first time to its neighbours.

    after d hops a row is d blocks old; each row is sent twice, so that a single lost message does no harm

Rows may arrive in any order. A row that never arrives delays no other. Memory is bounded whatever neighbours send: a
table of the newest blocks with one entry per row and robot.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from coheft.agents.efficient.row_times import RowTimes
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.rows import FLEXING_SIZE, ROW_SIZE

WINDOW = 64
"""Number of newest blocks whose rows are accepted, if it is not less than the hops or the checks of seals need."""
_LABELS, _ROWS = "labels", "rows"
_ONE = np.ones(1)
_SHAPES = tuple((ROW_SIZE * copies + more,) for copies in (1, 2) for more in (0, FLEXING_SIZE))
_TEAMS = 2**32
"""Team numbers are below this."""
_LARGEST = 1e6
"""No norm of the rows of one message is larger; units as in ``coheft.estimation.moments.rows``."""


class Copy(NamedTuple):
    """A row in single precision as the neighbour ``sender`` has sent it; ``robot`` is the index of the one that
    measured it.
    """

    sender: str
    robot: int
    number: int
    row: bytes


@dataclass(frozen=True, eq=False)
class RowMessage:
    """Message of a robot to its neighbours after a block.

    Attributes:
        team: Number of the sender's team, see ``Gossip.membership``.
        news_at: Number of the first row after the newest change of load or grasp that the sender knows, -1 if none.
        labels: Index of the robot and number of each row, shape (k, 2).
        rows: Shape (k, 24), or more with rates and flexing, in single precision: rounding errors are far below the
            noise, and occur once, at the robot that measured.
        sender: Name of the neighbour, if this robot has received the message.
    """

    team: int
    news_at: int
    labels: npt.NDArray[np.int32]
    rows: npt.NDArray[np.float32]
    sender: str = ""

    def channels(self) -> dict[str, npt.NDArray[np.generic]]:
        """Return arrays by name; the first label is ``(team, news_at)``."""
        head = np.array([[self.team, self.news_at]]).astype(np.int32)
        return {_LABELS: np.concatenate([head, self.labels]), _ROWS: self.rows}

    @staticmethod
    def of_channels(channels: Mapping[str, npt.NDArray[Any]], sender: str = "") -> RowMessage | None:
        """Inverse of ``channels``; None if the arrays are not such a message."""
        labels, rows = channels.get(_LABELS), channels.get(_ROWS)
        if labels is None or rows is None or labels.dtype != np.int32 or rows.dtype != np.float32:
            return None
        if rows.shape[1:] not in _SHAPES or labels.shape != (len(rows) + 1, 2):
            return None
        team, news_at = labels[0].tolist()
        return RowMessage(team % _TEAMS, news_at, labels[1:], rows, sender)

    def copies(self) -> Iterator[Copy]:
        """Iterate over the rows of the message."""
        for (robot, number), row in zip(self.labels.tolist(), self.rows, strict=True):
            yield Copy(self.sender, robot, number, row.tobytes())


class Exchange:
    """One robot's table of rows in transit.

    Args:
        team: Number of the team.
        count: Number of robots.
        own: Index of this robot.
        hops: Diameter of the graph.
        times: Times of rows.
        size: Length of one robot's row, with rates if there are any.
        sealing: Number of blocks after which rows may still be compared with seals; 0 if there are no seals.

    Attributes:
        news_at: Number of the first row after a change, the newest that any robot has reported; -1 if none.
        window: Number of newest blocks whose rows are accepted.
        disputed: Robots of which two different rows with one number arrived, and the block in which it last happened.
        distrusted: Neighbours and the robots whose rows these sent wrongly, and the block in which it last showed.
        aside: Rows by sender, robot and number that are not in the table, because they differ from it or their sender
            is distrusted; empty if there are no seals.
    """

    def __init__(
        self, team: int, count: int, own: int, hops: int, times: RowTimes, size: int = ROW_SIZE, sealing: int = 0
    ) -> None:
        self.team, self.news_at = team, -1
        self.disputed: dict[int, int] = {}
        self.distrusted: dict[tuple[str, int], int] = {}
        self.aside: dict[tuple[str, int, int], bytes] = {}
        self._count, self._own, self._times, self._size = count, own, times, size
        self.window = max(WINDOW, 2 * hops, sealing)
        self._received = deque[tuple[int, RowMessage]]()  # with the block of each, if there are seals
        self._is_sealing = sealing > 0
        self._rows: dict[int, dict[int, bytes]] = {}  # by number and robot, in single precision
        self._oldest: int | None = None  # smallest number that may be in the table
        self._news: dict[tuple[int, int], bytes] = {}  # by robot and number
        self._sent_once: dict[tuple[int, int], bytes] = {}

    def add_own(self, number: int, row: Array) -> None:
        """Add this robot's own row, shape (size,)."""
        rows = self._rows.setdefault(number, {})
        if self._own not in rows:
            rows[self._own] = row.astype(np.float32).tobytes()
            self._news[self._own, number] = rows[self._own]

    def receive(self, messages: Iterable[RowMessage], block: int) -> None:
        """Process neighbours' messages that arrived before this block; of two different rows the first one counts."""
        begun, newest = self._times.begun_from(block), self._times.complete(block - 1)
        oldest = max(0, self._times.complete(block - self.window))
        for number in range(oldest if self._oldest is None else self._oldest, oldest):
            self._rows.pop(number, None)
        self._oldest = oldest
        length = self._size * np.dtype(np.float32).itemsize
        while self._received and self._received[0][0] < block - self.window:
            self._received.popleft()
        self.aside = {key: row for key, row in self.aside.items() if key[2] >= oldest}
        for message in messages:
            if message.team != self.team or message.rows.shape[1] != self._size:
                continue
            if not np.vdot(message.rows, message.rows) < _LARGEST**2:
                continue  # damaged: fits could not be computed with such numbers
            if self._is_sealing:
                self._received.append((block, message))
            if self.news_at < message.news_at < begun:
                self.news_at = message.news_at
            data = message.rows.tobytes()
            for index, (robot, number) in enumerate(message.labels.tolist()):
                if not 0 <= robot < self._count or not oldest <= number < newest:
                    continue
                row = data[length * index : length * (index + 1)]
                if self.distrusted and (message.sender, robot) in self.distrusted:
                    self.aside.setdefault((message.sender, robot, number), row)
                    continue
                first = self._rows.setdefault(number, {}).setdefault(robot, row)
                if first is row:
                    self._news[robot, number] = row
                elif first != row:
                    self.disputed[robot] = block
                    if self._is_sealing:
                        self.aside.setdefault((message.sender, robot, number), row)

    def message(self, news_at: int) -> RowMessage:
        """Return the message for all neighbours; ``news_at`` as in ``RowMessage``."""
        sent = self._sent_once | self._news
        self._sent_once, self._news = self._news, {}
        labels = np.array(list(sent), dtype=np.int32).reshape(-1, 2)
        return RowMessage(self.team, news_at, labels, self._array(sent.values()))

    def complete(self, number: int) -> Array | None:
        """Return the team's row of this number: the rows of all robots, the constant 1, and what follows rows, shape
        (size N + 1,); None while a robot's is missing.
        """
        known = self._rows.get(number, {})
        if len(known) < self._count:
            return None
        rows = self._array(map(known.__getitem__, range(self._count)))
        return np.concatenate([rows[:, :ROW_SIZE].ravel(), _ONE, rows[:, ROW_SIZE:].ravel()])

    def missing(self, number: int) -> list[int]:
        """Indices of the robots whose row of this number, or the oldest later one that is kept, has not arrived."""
        number = max(number, self._oldest or 0)
        return [robot for robot in range(self._count) if robot not in self._rows.get(number, {})]

    def row(self, robot: int, number: int) -> bytes | None:
        """Return a robot's row in single precision, None if there is none."""
        return self._rows.get(number, {}).get(robot)

    def restore(self, copy: Copy) -> None:
        """Add a row that has been set aside."""
        self._rows.setdefault(copy.number, {})[copy.robot] = copy.row
        self._news[copy.robot, copy.number] = copy.row

    def remove(self, robot: int, number: int) -> list[Copy]:
        """Remove a robot's row; return the copies of it that neighbours have sent."""
        row = self._rows.get(number, {}).pop(robot, None)
        everything = (copy for _, message in self._received for copy in message.copies())
        return [copy for copy in everything if copy[1:] == (robot, number, row)]

    def _array(self, rows: Iterable[bytes]) -> npt.NDArray[np.float32]:
        return np.frombuffer(b"".join(rows), dtype=np.float32).reshape(-1, self._size)
