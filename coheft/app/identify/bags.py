"""Reads topics from MCAP files, by coheft or by others, and from bags of ROS 2 and ROS 1.

Needs the packages of the extra ``record``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager
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
from coheft.wire.process.log import LOG


def _pose(pose: Any) -> tuple[float, ...]:
    return *ros.xyz(pose.position), *ros.xyz(pose.orientation), pose.orientation.w


_Message = tuple[int, int, Sequence[float]]
"""Its stamp and the time of its reception [ns], and its numbers."""
_LOOKED_AT = 500
"""Number of the first messages whose stamps are checked."""
_DISTINCT = 0.2
"""Share of different stamps with which messages were merely recorded several times."""
_OUT_OF_ORDER = 5 * 10**8
"""Largest step back of stamps, of messages that have overtaken others [ns]."""
IN_PLACE_OF_POSES = frozenset({"nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu"})
"""Types that are used, unless ``--topics`` names them, only of robots without poses of other types."""
KINDS: dict[str, tuple[str, Callable[[Any], Sequence[float]]]] = {
    "geometry_msgs/msg/WrenchStamped": ("wrench", ros.wrench_in),
    "geometry_msgs/msg/PoseStamped": ("pose", lambda m: _pose(m.pose)),
    "geometry_msgs/msg/PoseWithCovarianceStamped": ("pose", lambda m: _pose(m.pose.pose)),
    "geometry_msgs/msg/TransformStamped": (
        "pose",
        lambda m: (*ros.xyz(m.transform.translation), *ros.xyz(m.transform.rotation), m.transform.rotation.w),
    ),
    "geometry_msgs/msg/TwistStamped": ("twist", ros.twist_in),
    "nav_msgs/msg/Odometry": ("pose", lambda m: _pose(m.pose.pose)),
    "sensor_msgs/msg/Imu": ("acceleration", lambda m: ros.xyz(m.linear_acceleration)),
    "geometry_msgs/msg/AccelStamped": ("acceleration", ros.acceleration_in),
}
"""By type of messages, the channel of ``RobotRecord`` that they measure, and its numbers in a message."""


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
    """An open file or folder of messages.

    Attributes:
        topics: All topics in it.
    """

    def __init__(self, reader: Any, *, is_ros1: bool) -> None:
        self._reader = reader
        self._read = get_typestore(Stores.ROS1_NOETIC).deserialize_ros1 if is_ros1 else ros.from_cdr
        counts: Counter[tuple[str, str]] = Counter()
        for each in reader.connections:
            counts[each.topic, each.msgtype] += each.msgcount
        self.topics = tuple(BagTopic(*key, count) for key, count in sorted(counts.items()))

    @classmethod
    @contextmanager
    def open(cls, path: Path) -> Iterator[Bag]:
        """Open a file, or the folder of a bag."""
        if path.suffix == ".mcap":
            with path.open("rb") as file:
                if not is_finished(file):
                    raise RecordingError(
                        f"it is not complete: its writer was killed, or is still writing. Save what it contains with: "
                        f"coheft recover {path}"
                    )
        is_ros1 = path.suffix == ".bag"
        with ExitStack() as stack:
            with _damage("cannot be read as a recording of topics"):
                bag = cls(stack.enter_context(Ros1Reader(path) if is_ros1 else Ros2Reader(path)), is_ros1=is_ros1)
            yield bag

    def streams(self, names: Collection[str]) -> dict[str, Stream]:
        """Read topics whose types are in ``KINDS``, with the times in the headers."""
        chosen = [each for each in self._reader.connections if each.topic in names and each.msgtype in KINDS]
        found: dict[str, list[_Message]] = {name: [] for name in names}
        with _damage("it is damaged"):
            for connection, time, data in self._reader.messages(chosen):
                message = self._read(data, connection.msgtype)
                numbers = KINDS[connection.msgtype][1](message)
                found[connection.topic].append((ros.time_of(message), time, numbers))
        return {name: _stream(name, messages) for name, messages in found.items()}


@contextmanager
def _damage(failure: str) -> Iterator[None]:
    """Raise ``RecordingError`` for damaged files, for which the libraries raise many kinds of errors."""
    try:
        yield
    except OSError:
        raise
    except Exception as error:
        raise RecordingError(f"{failure}: {one_line(str(error))}") from error


def _check_stamps(name: str, messages: Sequence[_Message]) -> None:
    """Check that stamps are times of measurements."""
    pace = Pace()
    for stamp, arrival, _ in messages:
        pace.note(stamp, arrival)
    fault = pace.fault(1.0)
    if fault is None or fault.kind not in ("still", "equal", "bunched", "unit"):
        return
    stamps, received, _ = zip(*messages, strict=True)
    is_slow = np.ptp(stamps) < np.ptp(received)  # times of writing tell nothing if they are fast
    is_double = fault.kind == "equal" and len(set(stamps)) > _DISTINCT * len(stamps)
    if not is_double and (is_slow or fault.kind != "unit"):
        raise RecordingError(f"{one_line(name)}: {fault.words}")


def _stream(name: str, messages: Sequence[_Message]) -> Stream:
    """The messages of a topic in the order of their stamps, without duplicates."""
    time = np.array([stamp for stamp, _, _ in messages], dtype=np.int64)
    values = np.array([numbers for _, _, numbers in messages], dtype=np.float64)
    zeros = int(np.count_nonzero(time == 0))
    if zeros > 1:
        if zeros < len(time):
            raise RecordingError(
                f"{one_line(name)}: {zeros} of {len(time)} messages have a stamp of zero: expected the time of each "
                f"measurement"
            )
        LOG.warning(f"coheft: {one_line(name)}: all stamps are zero: messages are taken for measured when recorded")
        time = np.array([received for _, received, _ in messages], dtype=np.int64)
    else:
        _check_stamps(name, messages[:_LOOKED_AT])
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
