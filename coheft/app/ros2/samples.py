"""One robot's measurements from ROS 2: three streams of standard messages, combined to blocks by their stamps."""

import time
from collections.abc import Callable, Iterator, Sequence
from queue import Empty, SimpleQueue
from typing import NamedTuple

import numpy as np

from coheft.app.recording import ros
from coheft.app.ros2.pace import Pace
from coheft.app.ros2.stamps import Stamps
from coheft.errors import MessageError
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import ACCELERATION, TWIST, WRENCH
from coheft.wire.scenario.robot_sensors import RobotSensors

_OPEN = 8
"""Largest number of incomplete blocks."""
AT_ONCE = 1024
"""Number of measurements read before agents are served, because measurements may arrive faster than they are read."""
_ROOM = 2**16
"""Largest number of measurements in the queue; when it is full, the newest are lost."""


class Stream(NamedTuple):
    """A stream of measurements: type of its messages, columns in a sample, and the numbers of a message."""

    kind: str
    columns: slice
    numbers: Callable[[ros.RosMessage], Sequence[float]]


STREAMS = {
    "wrench": Stream("geometry_msgs/msg/WrenchStamped", WRENCH, ros.wrench_in),
    "twist": Stream("geometry_msgs/msg/TwistStamped", TWIST, ros.twist_in),
    "acceleration": Stream("geometry_msgs/msg/AccelStamped", ACCELERATION, ros.acceleration_in),
}
"""Streams by the last part of the topic's name."""


def streams_of(sensors: RobotSensors) -> tuple[str, ...]:
    """Return the streams of a robot with these sensors: those of which it measures anything."""
    missing = sensors.is_missing()
    return tuple(name for name, stream in STREAMS.items() if not missing[stream.columns].all())


def read(stream: str, cdr: bytes) -> tuple[int, Array]:
    """Return the stamp of a measurement [ns] and its numbers, as many as the stream has columns.

    It raises a ``MessageError`` for another type, numbers that are not finite, or a missing stamp.
    """
    message = ros.from_cdr(cdr, STREAMS[stream].kind)
    if ros.time_of(message) == 0:
        raise MessageError("its stamp is zero: expected the time of the measurement in header.stamp")
    values = np.array(STREAMS[stream].numbers(message))
    if not np.isfinite(values).all():
        raise MessageError(f"{stream} contains {int((~np.isfinite(values)).sum())} numbers that are not finite")
    return ros.time_of(message), values


class Reading(NamedTuple):
    """A measurement with its stamp [ns] and its arrival [ns] by our own clock."""

    robot: str
    stream: str
    stamp: int
    values: Array
    arrival: int


class Readings:
    """Queue of measurements; ``complain`` is called with descriptions of refused messages.

    ``received`` are the streams, by robot and kind, of which any message arrived, including refused ones.
    """

    def __init__(self, complain: Callable[[str], None]) -> None:
        self.received: set[tuple[str, str]] = set()
        self._complain = complain
        self._waiting: SimpleQueue[tuple[str, str, bytes, int]] = SimpleQueue()

    def put(self, robot: str, stream: str, cdr: bytes) -> None:
        """Add a message to the queue, in any thread."""
        self.received.add((robot, stream))
        if self._waiting.qsize() < _ROOM:
            self._waiting.put((robot, stream, cdr, time.monotonic_ns()))

    def forget(self) -> None:
        """Empty the queue."""
        while not self._waiting.empty():
            self._waiting.get()

    def take(self, seconds: float) -> Iterator[Reading]:
        """Return valid measurements from the queue, up to a limit; if it is empty, wait for a time."""
        for number in range(AT_ONCE):
            try:
                item = self._waiting.get_nowait() if number else self._waiting.get(timeout=seconds)
            except Empty:
                return
            robot, stream, cdr, arrival = item
            try:
                reading = Reading(robot, stream, *read(stream, cdr), arrival)
            except MessageError as error:
                self._complain(f"refused from /{robot}/{stream}: {error}")
                continue
            yield reading


class BlockBuilder:
    """Combines the measurements of one robot to blocks.

    The time since the epoch is cut into samples of equal length; a measurement belongs to the sample whose time is
    nearest to its stamp. A block is complete when each of its samples has a measurement of each stream. One that still
    misses some when a later one is complete is given up: an agent can do without a block, not with half of one.

    Args:
        epoch: Stamp of sample 0 of block 0 [ns].
        sensors: The robot's sensors; what is missing is zero.

    Attributes:
        counts: Measurements that have arrived since the last complete block, by stream.
        behind: Time by which the last of these is older than the next possible block [s]; 0 if it is not.
    """

    def __init__(self, robot: str, rate: int, block: int, epoch: int, stamps: Stamps, sensors: RobotSensors) -> None:
        self.counts = dict.fromkeys(streams_of(sensors), 0)
        self.behind = 0.0
        self.paces = {stream: Pace() for stream in self.counts}
        self._robot = robot
        self._stamps = stamps
        self._empty = np.repeat(np.where(sensors.is_missing(), 0.0, np.nan)[None], block, axis=0)
        self._rate, self._block, self._epoch = rate, block, epoch
        self._open: dict[int, Array] = {}
        self._newest = -1

    def add(self, stream: str, stamp: int, values: Array, arrival: int) -> tuple[int, Array] | None:
        """Add a measurement with its stamp and its arrival by our own clock [ns]; errors as of ``Stamps.check``.

        Return the block that it completes: its number, and the samples (B, 15).
        """
        self.counts[stream] += 1
        self.paces[stream].note(stamp, arrival)
        self.behind = 0.0
        self._stamps.check(self._robot, stamp, arrival)
        sample = (2 * (stamp - self._epoch) * self._rate + 10**9) // (2 * 10**9)
        number, row = divmod(sample, self._block)
        if number <= self._newest:
            self.behind = (self._newest + 1) * self._block / self._rate - (stamp - self._epoch) / 1e9
            return None
        samples = self._open.setdefault(number, self._empty.copy())
        samples[row, STREAMS[stream].columns] = values
        if np.isnan(samples).any():
            self._give_up(list(self._open)[:-_OPEN])  # the first to be opened: a wrong stamp may be far in the future
            return None
        self._newest = number
        self._stamps.trust(stamp, arrival)
        self.counts = dict.fromkeys(self.counts, 0)
        del self._open[number]
        self._give_up([other for other in self._open if other < number])
        return number, samples

    def _give_up(self, numbers: Sequence[int]) -> None:
        for number in numbers:
            del self._open[number]
