"""Columns as named by ``rostopic echo -p``: one file per topic, stamps in nanoseconds, texts between numbers."""

import re
from itertools import chain

from coheft.errors import RecordingError, one_line
from coheft.estimation.batch.alignment import Stream
from coheft.estimation.geometry.spatial import Array
from coheft.wire.data.table import Table
from coheft.wire.process.log import LOG

_RECEIVED = "%time"
_STAMP = "header.stamp"
_SECONDS = ("header.stamp.secs", "header.stamp.sec")
_NANOSECONDS = ("header.stamp.nsecs", "header.stamp.nanosec")
"""Stamps in two columns, as bagpy and others write them; without the prefix."""
_FIELD = "field."
_TO_SECONDS = 1e-9
_ENDS = {
    channel: tuple(f"{part}.{axis}" for part, axes in parts for axis in axes)
    for channel, parts in {
        "pose": (("position", "xyz"), ("orientation", "xyzw")),
        "twist": (("twist.angular", "xyz"), ("twist.linear", "xyz")),
        "acceleration": (("accel.linear", "xyz"),),
        "wrench": (("force", "xyz"), ("torque", "xyz")),
    }.items()
}
"""Last parts of the columns' names by channel, in the order of ``RobotRecord``."""
_OTHER_NAMES = {
    "transform.translation": "position",
    "transform.rotation": "orientation",
    "linear_acceleration": "accel.linear",
}
"""Names in poses of other types, and in accelerations of an IMU, that are treated in the same way."""
_WORDS = frozenset(
    [
        *("wrench", "wrenches", "ft", "force", "forces", "torque", "pose", "poses", "tcp", "twist", "velocity"),
        *("accel", "acceleration", "imu", "stamped", "topic", "sensor", "sensors", "tool", "tool0", "raw", "filtered"),
    ]
)
"""Words in a file's name that belong to the topic, not to the robot."""


def is_of_ros(table: Table) -> bool:
    """Whether a table has the columns of a ROS topic."""
    return table.names[0] == _RECEIVED or any(
        name.startswith(_FIELD) or name.endswith(_SECONDS) for name in table.names
    )


def robot_named(stem: str) -> str:
    """Return the robot of a file: its name without words of the topic, ``left`` of ``left_wrench``."""
    words = [word for word in re.split(r"[-_. ]+", stem) if word]
    kept = [word for word in words if word.lower() not in _WORDS]
    return "_".join(kept) or stem


def streams_of(table: Table) -> dict[str, Stream]:
    """Return the measurements of a topic's messages by channel, with the stamps of their headers in seconds.

    Without stamps, the times of receipt are used, which is logged.
    """
    columns = _known_columns(table)
    found: dict[str, Array] = {}
    for channel, wanted in _ENDS.items():
        missing = [name for name in wanted if name not in columns]
        if set(wanted[:3]) <= set(missing):  # an IMU has an orientation without a position
            continue
        if missing:
            raise RecordingError(
                f"{table.file}: '{channel}' lacks column{'s' * (len(missing) > 1)} "
                f"{', '.join(_FIELD + name for name in missing)}; found {table.listed}"
            )
        found[channel] = table.numbers([columns[name] for name in wanted])
    if not found:
        expected = "; ".join(
            f"{channel}: {' '.join(f'{_FIELD}….{end}' for end in ends)}" for channel, ends in _ENDS.items()
        )
        raise RecordingError(
            f"{table.file}: found columns {table.listed}: none of what a robot measures; expected {expected}"
        )
    time = _times(table)
    return {channel: Stream(time, values) for channel, values in found.items()}


def _known_columns(table: Table) -> dict[str, str]:
    """Return columns by the last parts of their names, as in ``_ENDS``: ``force.x`` for ``field.wrench.force.x``."""
    found: dict[str, str] = {}
    for name in table.names:
        plain = name
        for other, ours in _OTHER_NAMES.items():
            plain = plain.replace(other, ours)
        for end in chain.from_iterable(_ENDS.values()):
            if f".{plain}".endswith(f".{end}"):
                if end in found:
                    raise RecordingError(
                        f"{table.file}: columns '{one_line(found[end])}' and '{one_line(name)}' both tell {end}: "
                        f"expected one, remove the other"
                    )
                found[end] = name
    return found


def _times(table: Table) -> Array:
    """Return the times of samples, shape (n,) [s]."""
    split = [[name for name in table.names if name.endswith(ends)] for ends in (_SECONDS, _NANOSECONDS)]
    if all(split):
        seconds, nanoseconds = table.numbers([names[0] for names in split]).T
        table.check_growing(seconds * 1e9 + nanoseconds, " ns")
        whole: Array = seconds + nanoseconds * _TO_SECONDS
        return whole
    stamps = [name for name in table.names if name.endswith(_STAMP)]
    names = [*stamps[:1], *(name for name in (_RECEIVED,) if name in table.names)]
    if not names:
        raise RecordingError(
            f"{table.file}: found no column {_RECEIVED} or {_FIELD}{_STAMP}: expected one with times in nanoseconds"
        )
    times = table.numbers(names)
    if len(times) < 2:
        raise RecordingError(f"{table.file}: found {len(times)} messages, expected a line for each")
    time = times[:, 0]
    if not time.any() and len(names) > 1:
        LOG.warning(f"coheft: {table.file}: all stamps are zero: taken from {_RECEIVED}, when messages were received")
        time = times[:, 1]
    elif names[0] == _RECEIVED:
        LOG.warning(f"coheft: {table.file}: no {_FIELD}{_STAMP}: taken from {_RECEIVED}, when messages were received")
    table.check_growing(time, " ns")
    return time * _TO_SECONDS
