"""Stock ROS 2 messages from arrays, and their bytes (CDR).

Every time is simulated time in nanoseconds. The order of components is this project's: twists ``(w, v)``, wrenches
``(f, t)``, quaternions with the scalar first. What is not known is NaN.
"""

from collections.abc import Iterable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore

from coheft.errors import MessageError
from coheft.estimation.geometry.spatial import Array, Pose, quaternion_from_rotation

_STORE = get_typestore(Stores.ROS2_HUMBLE)
_UNKNOWN = np.full((3, 3), np.nan)

INFO, WARN = 20, 30
"""Levels of ``log``."""
OK, DOUBTFUL, STALE = 0, 1, 3
"""Levels of ``diagnostics``."""

RosMessage = Any
"""A message of the type that its ``__msgtype__`` names."""


class MarkedBox(NamedTuple):
    """A box to show: pose, edge lengths [m], and red, green, blue and opacity from 0 to 1."""

    pose: Pose
    size: tuple[float, float, float]
    colour: tuple[float, float, float, float]


_PACKAGES = frozenset(
    ["builtin_interfaces", "diagnostic_msgs", "geometry_msgs", "rcl_interfaces", "rosgraph_msgs"]
    + ["sensor_msgs", "std_msgs", "tf2_msgs", "visualization_msgs"]
)
_msg: Any = SimpleNamespace(
    **{name.split("/")[-1]: kind for name, kind in _STORE.types.items() if name.split("/")[0] in _PACKAGES}
)
"""All types of messages in these packages, by name."""

BYTES_TYPE = str(_msg.UInt8MultiArray.__msgtype__)


def to_cdr(message: RosMessage) -> bytes | memoryview:
    """Encode a message as CDR, little-endian."""
    data: bytes | memoryview = _STORE.serialize_cdr(message, message.__msgtype__)
    return data


def from_cdr(cdr: bytes, kind: str) -> RosMessage:
    """Decode a message of a type from CDR; raise ``MessageError`` if it has another."""
    try:
        return _STORE.deserialize_cdr(cdr, kind)
    except SerdeError as error:
        raise MessageError(f"not a {kind}: {error}") from error


def definition(kind: str) -> bytes:
    """Return the definition of a type and of all types in it, as text for recordings."""
    text: str = _STORE.generate_msgdef(kind, ros_version=2)[0]
    return text.encode()


def type_hash(kind: str) -> str:
    """Return the hash of a type's definition (REP 2016)."""
    text: str = _STORE.hash_rihs01(kind)
    return text


def of_bytes(data: bytes) -> RosMessage:
    """Return a message with bytes."""
    return _msg.UInt8MultiArray(_msg.MultiArrayLayout(dim=[], data_offset=0), np.frombuffer(data, np.uint8))


def bytes_in(cdr: bytes) -> bytes:
    """Return the bytes in a message of ``of_bytes``, given as CDR; raise ``MessageError`` if it is another."""
    data: bytes = from_cdr(cdr, BYTES_TYPE).data.tobytes()
    return data


def number(value: float) -> RosMessage:
    """Return a message with a number."""
    return _msg.Float64(value)


def wrench(time: int, frame: str, wrench: Array) -> RosMessage:
    """Return a message with a wrench ``(f, t)``, shape (6,) [N, N·m]."""
    force, torque = np.asarray(wrench).reshape(2, 3).tolist()
    return _msg.WrenchStamped(_header(time, frame), _msg.Wrench(_msg.Vector3(*force), _msg.Vector3(*torque)))


def twist(time: int, frame: str, twist: Array) -> RosMessage:
    """Return a message with a twist ``(w, v)``, shape (6,) [rad/s, m/s]."""
    angular, linear = np.asarray(twist).reshape(2, 3).tolist()
    return _msg.TwistStamped(
        _header(time, frame), _msg.Twist(linear=_msg.Vector3(*linear), angular=_msg.Vector3(*angular))
    )


def acceleration(time: int, frame: str, linear: Array) -> RosMessage:
    """Return a message with a linear acceleration (3,) [m/s²]; the angular one is unknown."""
    unknown = _msg.Vector3(np.nan, np.nan, np.nan)
    return _msg.AccelStamped(_header(time, frame), _msg.Accel(linear=_msg.Vector3(*linear.tolist()), angular=unknown))


def inertia(time: int, frame: str, mass: float, com: Array | None, tensor: Array | None) -> RosMessage:
    """Return a message with mass [kg], centre of mass (3,) [m], and inertia about it (3, 3) [kg·m²]."""
    xx, xy, xz, yy, yz, zz = (_UNKNOWN if tensor is None else np.asarray(tensor))[np.triu_indices(3)].tolist()
    centre = _msg.Vector3(*(_UNKNOWN[0] if com is None else np.asarray(com)).tolist())
    return _msg.InertiaStamped(_header(time, frame), _msg.Inertia(mass, centre, xx, xy, xz, yy, yz, zz))


def pose(time: int, frame: str, position: Array, quaternion: Array) -> RosMessage:
    """Return a message with a position (3,) [m] and a quaternion (4,)."""
    return _msg.PoseStamped(_header(time, frame), _pose(position, quaternion))


def pose_with_covariance(time: int, frame: str, pose: Pose, covariance: Array) -> RosMessage:
    """Return a message with a pose and its covariance (6, 6): rotation vector in ``frame`` [rad], translation [m]."""
    order = [3, 4, 5, 0, 1, 2]  # ROS: translation first
    ordered = np.ascontiguousarray(covariance[np.ix_(order, order)]).reshape(36)
    own = _pose(pose.translation, quaternion_from_rotation(pose.rotation))
    return _msg.PoseWithCovarianceStamped(_header(time, frame), _msg.PoseWithCovariance(own, ordered))


def transforms(time: int, frame: str, poses: Mapping[str, tuple[Array, Array]]) -> RosMessage:
    """Return a message with positions (3,) [m] and quaternions (4,) of frames in ``frame``, by name."""
    return _msg.TFMessage(
        [
            _msg.TransformStamped(
                _header(time, frame), child, _msg.Transform(_msg.Vector3(*position.tolist()), _quaternion(quaternion))
            )
            for child, (position, quaternion) in poses.items()
        ]
    )


def boxes(time: int, frame: str, boxes: Sequence[MarkedBox]) -> RosMessage:
    """Return a message with boxes that replace all former ones."""
    before = _marker(time, frame, 0, MarkedBox(Pose.identity(), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)))
    before.action = _msg.Marker.DELETEALL
    return _msg.MarkerArray([before, *(_marker(time, frame, number, box) for number, box in enumerate(boxes))])


def diagnostics(time: int, name: str, level: int, text: str, values: Iterable[tuple[str, object]]) -> RosMessage:
    """Return a message with the status of a robot."""
    pairs = [_msg.KeyValue(key, str(value)) for key, value in values]
    return _msg.DiagnosticArray(_header(time, ""), [_msg.DiagnosticStatus(level, name, text, name, pairs)])


def log(time: int, name: str, level: int, text: str) -> RosMessage:
    """Return a message with a line of a log."""
    return _msg.Log(stamp=_stamp(time), level=level, name=name, msg=text, file="", function="", line=0)


def clock(time: int) -> RosMessage:
    """Return a message with the present time."""
    return _msg.Clock(_stamp(time))


def time_of(message: RosMessage) -> int:
    """Return the time in the header of a message [ns]."""
    stamp = message.header.stamp
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def wrench_in(message: RosMessage) -> tuple[float, ...]:
    """Return ``(f, t)`` of a ``WrenchStamped``."""
    return *xyz(message.wrench.force), *xyz(message.wrench.torque)


def twist_in(message: RosMessage) -> tuple[float, ...]:
    """Return ``(w, v)`` of a ``TwistStamped``."""
    return *xyz(message.twist.angular), *xyz(message.twist.linear)


def acceleration_in(message: RosMessage) -> tuple[float, ...]:
    """Return the linear acceleration of an ``AccelStamped``."""
    return xyz(message.accel.linear)


def xyz(part: RosMessage) -> tuple[float, float, float]:
    """Return the numbers of a ``Vector3``, a ``Point``, or the imaginary part of a ``Quaternion``."""
    return part.x, part.y, part.z


def _stamp(time: int) -> RosMessage:
    return _msg.Time(*divmod(time, 10**9))


def _header(time: int, frame: str) -> RosMessage:
    return _msg.Header(_stamp(time), frame)


def _pose(position: Array, quaternion: Array) -> RosMessage:
    return _msg.Pose(_msg.Point(*position.tolist()), _quaternion(quaternion))


def _quaternion(quaternion: Array) -> RosMessage:
    w, x, y, z = np.asarray(quaternion).tolist()
    return _msg.Quaternion(x, y, z, w)


def _marker(time: int, frame: str, number: int, box: MarkedBox) -> RosMessage:
    nothing = np.zeros(0, np.uint8)
    return _msg.Marker(
        header=_header(time, frame),
        ns="",
        id=number,
        type=_msg.Marker.CUBE,
        action=_msg.Marker.ADD,
        pose=_pose(box.pose.translation, quaternion_from_rotation(box.pose.rotation)),
        scale=_msg.Vector3(*box.size),
        color=_msg.ColorRGBA(*box.colour),
        lifetime=_msg.Duration(0, 0),
        frame_locked=True,
        points=[],
        colors=[],
        texture_resource="",
        texture=_msg.CompressedImage(_header(0, ""), "", nothing),
        uv_coordinates=[],
        text="",
        mesh_resource="",
        mesh_file=_msg.MeshFile("", nothing),
        mesh_use_embedded_materials=False,
    )
