"""Messages to bytes and back: MessagePack, arrays as little-endian float64 with their shape.

``encode`` and ``decode`` are the only way in and out of a process; ``decode`` raises ``MessageError`` for anything that
is not exactly the message that was expected.
"""

from __future__ import annotations

import struct
from typing import Any, TypeVar

import msgspec
import numpy as np

from coheft.errors import MessageError
from coheft.estimation.spatial import Array
from coheft.wire.messages import PROTOCOL_VERSION, Message

_ARRAY_CODE = 1
_MAX_DIMENSIONS = 4

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
