"""One robot's measurements from ROS 2: three streams of standard messages, combined to blocks by their stamps."""

from __future__ import annotations

from collections.abc import Sequence
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


class Stream(NamedTuple):
    """A stream of measurements of one kind of sensor: type of its messages, and columns in a sample."""

    kind: str
    columns: slice


STREAMS = {
    "wrench": Stream("geometry_msgs/msg/WrenchStamped", WRENCH),
    "twist": Stream("geometry_msgs/msg/TwistStamped", TWIST),
    "acceleration": Stream("geometry_msgs/msg/AccelStamped", ACCELERATION),
}
"""Streams by the last part of the topic's name."""


def streams_of(sensors: RobotSensors) -> tuple[str, ...]:
    """Return the streams of a robot with these sensors: those of which it measures anything."""
    missing = sensors.is_missing()
    return tuple(name for name, stream in STREAMS.items() if not missing[stream.columns].all())


def read(stream: str, cdr: bytes) -> tuple[int, Array]:
    """Return the stamp of a measurement [ns] and its numbers, as many as the stream has columns.

    Raises:
        MessageError: It has another type, numbers that are not finite, or no stamp.
    """
    message = ros.from_cdr(cdr, STREAMS[stream].kind)
    if ros.time_of(message) == 0:
        raise MessageError("its stamp is zero: expected the time of the measurement in header.stamp")
    match stream:
        case "wrench":
            parts = [message.wrench.force, message.wrench.torque]
        case "twist":
            parts = [message.twist.angular, message.twist.linear]
        case _:
            parts = [message.accel.linear]
    values = np.concatenate([ros.vector(part) for part in parts])
    if not np.isfinite(values).all():
        raise MessageError(f"{stream} contains {int((~np.isfinite(values)).sum())} numbers that are not finite")
    return ros.time_of(message), values


class BlockBuilder:
    """Combines the measurements of one robot to blocks.

    The time since the epoch is cut into samples of equal length; a measurement belongs to the sample whose time is
    nearest to its stamp. A block is complete when each of its samples has a measurement of each stream. One that still
    misses some when a later one is complete is given up: an agent can do without a block, not with half of one.

    Args:
        epoch: Stamp of sample 0 of block 0 [ns].
        sensors: The robot's sensors; what is missing is zero.

    Attributes:
        given_up: Number of blocks that were never complete.
        counts: Measurements that have arrived since the last complete block, by stream.
        behind: Time by which the last of these is older than the next possible block [s]; 0 if it is not.
        paces: The pace of each stream.
    """

    def __init__(self, robot: str, rate: int, block: int, epoch: int, stamps: Stamps, sensors: RobotSensors) -> None:
        self.given_up = 0
        self.counts = dict.fromkeys(streams_of(sensors), 0)
        self.behind = 0.0
        self.paces = {stream: Pace() for stream in self.counts}
        self._robot = robot
        self._stamps = stamps
        self._empty = np.repeat(np.where(sensors.is_missing(), 0.0, np.nan)[None], block, axis=0)
        self._rate, self._block, self._epoch = rate, block, epoch
        self._open: dict[int, Array] = {}
        self._newest = -1

    def add(self, stream: str, time: int, values: Array, arrival: int) -> tuple[int, Array] | None:
        """Add a measurement; return the block that it completes: its number, and the samples (B, 15).

        Args:
            stream: Name of the stream.
            time: Its stamp [ns].
            values: Its numbers.
            arrival: Time of arrival [ns], by our own clock.

        Raises:
            MessageError: Its stamp is too far in the future.
        """
        self.counts[stream] += 1
        self.paces[stream].note(time, arrival)
        self.behind = 0.0
        self._stamps.check(self._robot, time, arrival)
        sample = (2 * (time - self._epoch) * self._rate + 10**9) // (2 * 10**9)
        number, row = divmod(sample, self._block)
        if number <= self._newest:
            self.behind = (self._newest + 1) * self._block / self._rate - (time - self._epoch) / 1e9
            return None
        samples = self._open.setdefault(number, self._empty.copy())
        samples[row, STREAMS[stream].columns] = values
        if np.isnan(samples).any():
            self._give_up(list(self._open)[:-_OPEN])  # the first to be opened: a wrong stamp may be far in the future
            return None
        self._newest = number
        self._stamps.trust(time, arrival)
        self.counts = dict.fromkeys(self.counts, 0)
        del self._open[number]
        self._give_up([other for other in self._open if other < number])
        return number, samples

    def _give_up(self, numbers: Sequence[int]) -> None:
        for number in numbers:
            del self._open[number]
        self.given_up += len(numbers)
