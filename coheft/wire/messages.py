"""Every message that crosses a process boundary: msgspec structs, MessagePack on the wire.

Arrays travel as little-endian float64 with their shape. ``encode`` and ``decode`` are the only way in and out;
``decode`` raises ``MessageError`` for anything that is not exactly the message that was expected.
"""

from __future__ import annotations

import struct
from typing import Any, Literal, TypeVar

import msgspec
import numpy as np

from coheft.errors import MessageError
from coheft.estimation.spatial import Array

PROTOCOL_VERSION = 1

_ARRAY_CODE = 1
_MAX_DIMENSIONS = 4


class Message(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Base of all messages; ``version`` must be equal on both sides."""

    version: int = PROTOCOL_VERSION


# --- robot plane: server <-> one robot ---------------------------------------------------------------------------


class Ready(Message, frozen=True):
    """Robot to server: all my links stand."""

    robot: str


class Measurements(Message, frozen=True):
    """Server to robot: its own sensors' samples of one block, see ``MeasurementBlock``. ``samples``: (B, 15)."""

    robot: str
    block: int
    samples: np.ndarray[Any, Any]


class Reference(Message, frozen=True):
    """Robot to server: the answer to one block of measurements, and what its arm shall do ``lag`` blocks later.

    Attributes:
        block: The block for which the reference holds.
        answers: The block of measurements that this answers.
        motion: Shape (B, 12): displacement from the home pose, rotation vector [rad] then position [m] in the axes of
            the home frame, and the rates of both.
        wrench: Feed-forward wrench ``(f, t)`` on the payload in ``F_i``, shape (6,) [N, N·m].
    """

    robot: str
    block: int
    answers: int
    motion: np.ndarray[Any, Any]
    wrench: np.ndarray[Any, Any]


class Stop(Message, frozen=True):
    """Server to robot: the run is over."""

    reason: str


# --- neighbour plane: agent <-> agent along an edge --------------------------------------------------------------


class Hello(Message, frozen=True):
    """Before the first block: I am here, and these neighbours I have heard."""

    sender: str
    heard: list[str]


class LinkState(msgspec.Struct, frozen=True, forbid_unknown_fields=True, order=True):
    """What one robot tells everybody about itself, handed on from neighbour to neighbour.

    Attributes:
        robot: Whom it is about.
        sequence: Grows with every change; the highest wins.
        neighbours: Names of its neighbours.
        ready_block: From this block on it can take part in the network's sums; -1 while it cannot.
        pose: Its grasp frame in the reference robot's, rotation row by row then position [m], 12 numbers; empty while
            unknown, or where the estimator does not need it.
    """

    robot: str
    sequence: int
    neighbours: tuple[str, ...]
    ready_block: int = -1
    pose: tuple[float, ...] = ()


class NeighbourMessage(Message, frozen=True):
    """Agent to each neighbour, once per block. All numbers are in the sender's own grasp frame.

    Attributes:
        sender: Who speaks.
        block: The block after which it was sent.
        gossip: News about robots, see ``LinkState``.
        channels: The estimator's arrays by name.
    """

    sender: str
    block: int
    gossip: list[LinkState]
    channels: dict[str, np.ndarray[Any, Any]]


# --- observer plane: everybody -> whoever watches; agents cannot hear it -----------------------------------------


class PayloadEstimate(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Mass properties of the payload in ``F_i`` with their covariance.

    Attributes:
        mass: [kg].
        com: (3,) [m].
        tensor: (3, 3) at the centre of mass [kg·m²].
        covariance: (10, 10) of ``(m, h, J packed as xx yy zz xy xz yz)``.
    """

    mass: float
    com: np.ndarray[Any, Any]
    tensor: np.ndarray[Any, Any]
    covariance: np.ndarray[Any, Any]


class PoseEstimate(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Pose of a neighbour's grasp frame in one's own.

    Attributes:
        rotation: ``R_ij`` (3, 3).
        translation: ``p_ij`` (3,) [m].
        covariance: (6, 6) of (rotation vector in the axes of ``F_i`` [rad], translation [m]).
    """

    rotation: np.ndarray[Any, Any]
    translation: np.ndarray[Any, Any]
    covariance: np.ndarray[Any, Any]


class LoadChangeNotice(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An agent noticed that the load changed: noticed after ``noticed_at`` [s], changed at about ``changed_at`` [s]."""

    noticed_at: float
    changed_at: float


class Estimate(Message, frozen=True):
    """What one agent believes after one block.

    Attributes:
        robot: Whose belief.
        block: The last block that it had seen.
        time: End of that block [s].
        phase: ``poses`` while relative poses are being found, then ``inertia``.
        converged: All numbers are known as well as the scenario asks.
        members: Size of the team as learned by gossip, 0 while unknown.
        payload: Mass properties in ``F_i``, None while unknown.
        poses: Neighbours' grasp frames in ``F_i``.
        total_block: Block to which ``total_wrench`` belongs, -1 if none.
        total_wrench: Total wrench (6,) about the origin of ``F_i`` at the last sample of ``total_block``.
        not_observable: What the motion so far cannot tell, in words.
        load_changes: Changes noticed so far.
        problems: Messages refused so far.
    """

    robot: str
    block: int
    time: float
    phase: Literal["poses", "inertia"]
    converged: bool
    members: int
    payload: PayloadEstimate | None
    poses: dict[str, PoseEstimate]
    total_block: int
    total_wrench: np.ndarray[Any, Any]
    not_observable: list[str]
    load_changes: list[LoadChangeNotice]
    problems: int = 0


class Problem(Message, frozen=True):
    """A process refused something and went on: who, and why."""

    source: str
    text: str


class PayloadTruth(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """True mass properties in the payload's frame."""

    mass: float
    com: np.ndarray[Any, Any]
    tensor: np.ndarray[Any, Any]


class LoadState(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A load on the payload: its id, mass [kg], position [m] and edge lengths [m] in the payload's frame."""

    id: int
    mass: float
    position: tuple[float, float, float]
    size: tuple[float, float, float]


class Truth(Message, frozen=True):
    """Server to observers, once per block; no agent can read it.

    Attributes:
        block: The block, all of whose samples were taken with this payload.
        time: End of the block [s].
        payload: True mass properties.
        loads: Loads that lie on the payload.
        position: Of the payload's frame in the world at the block's last sample, (3,) [m].
        quaternion: Its orientation, scalar first, (4,).
        total_wrench: Sum of all robots' **measured** wrenches of the last sample, carried with the true poses to the
            payload's frame, (6,).
        wrenches: Measured wrenches of the last sample, by robot in the order of the scene, (N, 6), each in its own
            frame.
    """

    block: int
    time: float
    payload: PayloadTruth
    loads: list[LoadState]
    position: np.ndarray[Any, Any]
    quaternion: np.ndarray[Any, Any]
    total_wrench: np.ndarray[Any, Any]
    wrenches: np.ndarray[Any, Any]


class Scene(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What does not change during a run: who holds the payload, and the true pose of each ``F_i`` in the payload."""

    robots: list[str]
    rotations: np.ndarray[Any, Any]
    translations: np.ndarray[Any, Any]
    neighbours: dict[str, list[str]]


# --- queries to the server, on the observer plane ----------------------------------------------------------------


class StatusRequest(Message, frozen=True, tag="status"):
    """How is the run?"""


class InjectRequest(Message, frozen=True, tag="inject"):
    """Put a load onto the payload at the next block."""

    mass: float
    position: tuple[float, float, float]
    size: tuple[float, float, float] = (0.1, 0.1, 0.1)


class RemoveRequest(Message, frozen=True, tag="remove"):
    """Take a load away at the next block."""

    load: int


class PauseRequest(Message, frozen=True, tag="pause"):
    """Stop the clock, or let it go on."""

    paused: bool


class StopRequest(Message, frozen=True, tag="stop"):
    """End the run."""


Request = StatusRequest | InjectRequest | RemoveRequest | PauseRequest | StopRequest


class Status(Message, frozen=True):
    """The server's answer to every request that it carried out."""

    scenario: str
    state: Literal["waiting", "running", "paused", "finished"]
    block: int
    time: float
    duration: float
    real_time_factor: float
    late_blocks: int
    loads: list[LoadState]
    slots_free: int
    waiting_for: list[str]
    scene: Scene


class Refusal(Message, frozen=True):
    """The server's answer to a request that it did not carry out, and why."""

    reason: str


# --- encoding ----------------------------------------------------------------------------------------------------

M = TypeVar("M")


def _pack(value: Any) -> msgspec.msgpack.Ext:
    if not isinstance(value, np.ndarray):
        raise NotImplementedError(f"cannot send a {type(value).__name__}")
    header = struct.pack(f"<B{value.ndim}I", value.ndim, *value.shape)
    return msgspec.msgpack.Ext(_ARRAY_CODE, header + value.astype("<f8", copy=False).tobytes())


def _unpack(code: int, data: memoryview) -> Array:
    if code != _ARRAY_CODE or not data or data[0] > _MAX_DIMENSIONS:
        raise ValueError("not an array of at most four dimensions")
    dimensions = data[0]
    shape = struct.unpack_from(f"<{dimensions}I", data, 1)
    return np.frombuffer(data, "<f8", offset=1 + 4 * dimensions).reshape(shape)


_encoder = msgspec.msgpack.Encoder(enc_hook=_pack)
_decoders: dict[Any, msgspec.msgpack.Decoder[Any]] = {}
_MALFORMED = (msgspec.DecodeError, ValueError, struct.error, RecursionError)
"""What decoding raises for bytes that are no message; the last for absurdly deep nesting."""


class _Header(msgspec.Struct):
    version: int


def encode(message: Message) -> bytes:
    """The message as bytes."""
    return _encoder.encode(message)


def decode(data: bytes, kind: type[M]) -> M:
    """The message in ``data``, which must be of type ``kind`` (a message, or a union of tagged ones).

    Raises:
        MessageError: The bytes are no such message, or one of another protocol version.
    """
    decoder = _decoders.get(kind)
    if decoder is None:
        decoder = _decoders[kind] = msgspec.msgpack.Decoder(kind, ext_hook=_unpack)
    name = getattr(kind, "__name__", str(kind))
    try:
        message: M = decoder.decode(data)
    except _MALFORMED as error:
        _check_version(data, name)
        raise MessageError(f"not a {name}: {error}") from error
    version = getattr(message, "version", PROTOCOL_VERSION)
    if version != PROTOCOL_VERSION:
        raise _version_error(name, version)
    return message


def _check_version(data: bytes, name: str) -> None:
    """Raise the clearer error when what does not fit is of another version anyway."""
    try:
        version = msgspec.msgpack.decode(data, type=_Header).version
    except _MALFORMED:
        return
    if version != PROTOCOL_VERSION:
        raise _version_error(name, version)


def _version_error(name: str, version: object) -> MessageError:
    return MessageError(
        f"{name} of protocol version {version}, but this process speaks version {PROTOCOL_VERSION}: "
        f"run the same release of coheft everywhere"
    )


def check_array(array: Array, shape: tuple[int, ...], name: str) -> None:
    """Check an array that came over the wire.

    Raises:
        MessageError: Its shape is not ``shape``, or a number in it is not finite.
    """
    if array.shape != shape:
        raise MessageError(f"{name}.shape is {array.shape} but expected {shape}")
    if not np.isfinite(array).all():
        count = int(np.size(array) - np.isfinite(array).sum())
        raise MessageError(f"{name} holds {count} numbers that are not finite")


def check_field(name: str, found: object, expected: object) -> None:
    """Check a field of a message that came over the wire.

    Raises:
        MessageError: It is not what is expected here.
    """
    if found != expected:
        raise MessageError(f"{name} is {found!r} but expected {expected!r}")
