"""Reads topics from MCAP files, by coheft or by others, and from bags of ROS 2 and ROS 1.

Needs the packages of the extra ``record``.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag2 import Reader as Ros2Reader
from rosbags.typesys import Stores, get_typestore

from coheft.app.recording import ros
from coheft.app.recording.mcap_records import is_finished
from coheft.app.ros2.pace import Pace
from coheft.errors import RecordingError, one_line
from coheft.estimation.batch.alignment import Stream
from coheft.estimation.geometry.spatial import Array
from coheft.wire.process.log import LOG


@dataclass(frozen=True)
class Kind:
    """A type of messages with measurements.

    Attributes:
        channel: The attribute of ``RobotRecord`` for them.
        numbers: Returns the numbers of a message, in the order of that attribute.
    """

    channel: str
    numbers: Callable[[Any], Sequence[float]]


def _pose(pose: Any) -> tuple[float, ...]:
    return *ros.xyz(pose.position), *ros.xyz(pose.orientation), pose.orientation.w


_LOOKED_AT = 500
"""Number of the first messages whose stamps are checked."""
_DISTINCT = 0.2
"""Share of different stamps with which messages were merely recorded several times."""
_OUT_OF_ORDER = 5 * 10**8
"""Largest step back of stamps, of messages that have overtaken others [ns]."""
IN_PLACE_OF_POSES = frozenset({"nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu"})
"""Types that are used, unless ``--topics`` names them, only of robots without poses of other types."""
KINDS = {
    "geometry_msgs/msg/WrenchStamped": Kind("wrench", ros.wrench_in),
    "geometry_msgs/msg/PoseStamped": Kind("pose", lambda m: _pose(m.pose)),
    "geometry_msgs/msg/PoseWithCovarianceStamped": Kind("pose", lambda m: _pose(m.pose.pose)),
    "geometry_msgs/msg/TransformStamped": Kind(
        "pose", lambda m: (*ros.xyz(m.transform.translation), *ros.xyz(m.transform.rotation), m.transform.rotation.w)
    ),
    "geometry_msgs/msg/TwistStamped": Kind("twist", ros.twist_in),
    "nav_msgs/msg/Odometry": Kind("pose", lambda m: _pose(m.pose.pose)),
    "sensor_msgs/msg/Imu": Kind("acceleration", lambda m: ros.xyz(m.linear_acceleration)),
    "geometry_msgs/msg/AccelStamped": Kind("acceleration", ros.acceleration_in),
}
"""Kinds by names of types."""


@dataclass(frozen=True)
class BagTopic:
    """A topic of a file: its name, and the type and number of its messages."""

    name: str
    kind: str
    count: int

    @property
    def words(self) -> str:
        """Name, type and number of messages, for an error message."""
        return f"{one_line(self.name)} ({one_line(self.kind.replace('/msg/', '/'))}, {self.count})"


class Bag:
    """An open file or folder of messages; use it as a context manager.

    Attributes:
        topics: All topics in it.

    Raises:
        RecordingError: It cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.topics: tuple[BagTopic, ...] = ()
        self._path = path
        self._is_ros1 = path.suffix == ".bag"
        self._reader: Any = None
        self._stack = ExitStack()

    def __enter__(self) -> Bag:
        if self._path.suffix == ".mcap":
            with self._path.open("rb") as file:
                if not is_finished(file):
                    raise RecordingError(
                        f"it is not complete: its writer was killed, or is still writing. Save what it contains with: "
                        f"coheft recover {self._path}"
                    )
        try:
            self._reader = Ros1Reader(self._path) if self._is_ros1 else Ros2Reader(self._path)
            self._stack.enter_context(self._reader)
            counts: dict[tuple[str, str], int] = {}
            for each in self._reader.connections:
                counts[each.topic, each.msgtype] = counts.get((each.topic, each.msgtype), 0) + each.msgcount
        except OSError:
            raise
        except Exception as error:  # the libraries raise many kinds of errors for damaged files
            raise RecordingError(f"cannot be read as a recording of topics: {one_line(str(error))}") from error
        self.topics = tuple(BagTopic(*key, count) for key, count in sorted(counts.items()))
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def streams(self, names: Collection[str]) -> dict[str, Stream]:
        """Read topics whose types are in ``KINDS``, with the times in the headers.

        Raises:
            RecordingError: The file is damaged, or messages are not valid.
        """
        chosen = [each for each in self._reader.connections if each.topic in names and each.msgtype in KINDS]
        stamps: dict[str, list[int]] = {name: [] for name in names}
        received: dict[str, list[int]] = {name: [] for name in names}
        values: dict[str, list[Sequence[float]]] = {name: [] for name in names}
        read = get_typestore(Stores.ROS1_NOETIC).deserialize_ros1 if self._is_ros1 else ros.from_cdr
        try:
            for connection, time, data in self._reader.messages(chosen) if chosen else ():
                message = read(data, connection.msgtype)
                stamps[connection.topic].append(ros.time_of(message))
                received[connection.topic].append(time)
                values[connection.topic].append(KINDS[connection.msgtype].numbers(message))
        except OSError:
            raise
        except Exception as error:  # as above
            raise RecordingError(f"it is damaged: {one_line(str(error))}") from error
        return {
            name: _stream(name, stamps[name], received[name], np.array(values[name], dtype=np.float64))
            for name in names
        }


def _check_stamps(name: str, stamps: list[int], received: list[int]) -> None:
    """Check that stamps are times of measurements.

    Raises:
        RecordingError: They stand still, lack nanoseconds, or are in another unit.
    """
    stamps, received = stamps[:_LOOKED_AT], received[:_LOOKED_AT]
    pace = Pace()
    for stamp, arrival in zip(stamps, received, strict=True):
        pace.note(stamp, arrival)
    fault = pace.fault(1.0)
    if fault is None or fault.kind not in ("still", "equal", "bunched", "unit"):
        return
    is_slow = np.ptp(stamps) < np.ptp(received)  # times of writing tell nothing if they are fast
    is_double = fault.kind == "equal" and len(set(stamps)) > _DISTINCT * len(stamps)
    if not is_double and (is_slow or fault.kind != "unit"):
        raise RecordingError(f"{one_line(name)}: {fault.words}")


def _stream(name: str, stamps: list[int], received: list[int], values: Array) -> Stream:
    """The messages of a topic in the order of their stamps, without duplicates.

    Raises:
        RecordingError: A number is not finite, or some stamps are missing.
    """
    time = np.array(stamps, dtype=np.int64)
    zeros = int(np.count_nonzero(time == 0))
    if zeros > 1:
        if zeros < len(time):
            raise RecordingError(
                f"{one_line(name)}: {zeros} of {len(time)} messages have a stamp of zero: expected the time of each "
                f"measurement"
            )
        LOG.warning(f"coheft: {one_line(name)}: all stamps are zero: messages are taken for measured when recorded")
        time = np.array(received, dtype=np.int64)
    else:
        _check_stamps(name, stamps, received)
    back = np.diff(time)
    if len(back) and back.min() < -_OUT_OF_ORDER:
        at = int(np.argmin(back)) + 1
        raise RecordingError(
            f"{one_line(name)}: the stamp of message {at + 1} is {-back.min() / 1e9:.3g} s before that of the one "
            f"before: was a clock set back, or were recordings joined? Cut it there, or record again"
        )
    time, kept = np.unique(time, return_index=True)
    if len(kept) < len(values):
        LOG.warning(
            f"coheft: {one_line(name)}: {len(values) - len(kept)} of {len(values)} messages have the stamp of another: "
            f"left out"
        )
    if not len(kept):
        return Stream(time / 1e9, values)
    values = values[kept]
    bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if len(bad):
        raise RecordingError(
            f"{one_line(name)}: {len(bad)} of {len(values)} messages hold numbers that are not finite, the first of "
            f"{time[bad[0]] / 1e9:.3f} s"
        )
    return Stream(time / 1e9, values)
