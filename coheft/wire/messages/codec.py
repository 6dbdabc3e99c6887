"""Messages to bytes and back: a checksum, then MessagePack with arrays as little-endian numbers with their shape.

``encode`` and ``decode`` are the only way in and out of a process; ``decode`` raises ``MessageError`` for anything that
is not exactly the message that was expected. The checksum covers the key under which the message is said, too, and a
key begins with the name of the run: what was damaged on its way, or said in an older run, by another process or under
another topic, is refused even where it would still be a message. It is no signature: that is what TLS is for.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Collection
from typing import Any, TypeVar

import msgspec
import numpy as np
import numpy.typing as npt

from coheft.errors import MessageError
from coheft.estimation.geometry.spatial import Array
from coheft.wire.messages.structs import PROTOCOL_VERSION, Message

_DTYPES: dict[int, np.dtype[Any]] = {1: np.dtype("<f8"), 2: np.dtype("<f4"), 3: np.dtype("<i4"), 4: np.dtype("<i8")}
"""Of arrays, by the code of their extension type; numbers of other kinds are sent in double precision."""
_CODES = {dtype: code for code, dtype in _DTYPES.items()}
_DOUBLE = 1
MAX_DIMENSIONS = 4
"""Of an array."""
_CHECKSUM = struct.Struct("<I")

M = TypeVar("M")


def _pack(value: Any) -> msgspec.msgpack.Ext:
    if not isinstance(value, np.ndarray):
        raise NotImplementedError(f"cannot send a {type(value).__name__}")
    header = struct.pack(f"<B{value.ndim}I", value.ndim, *value.shape)
    code = _CODES.get(value.dtype, _DOUBLE)
    return msgspec.msgpack.Ext(code, header + value.astype(_DTYPES[code], copy=False).tobytes())


def _unpack(code: int, data: memoryview) -> npt.NDArray[Any]:
    if code not in _DTYPES or not data or data[0] > MAX_DIMENSIONS:
        raise ValueError("not an array of at most four dimensions")
    dimensions = data[0]
    shape = struct.unpack_from(f"<{dimensions}I", data, 1)
    # A copy, because sums over arrays that begin at odd addresses may differ in their last digit.
    return np.frombuffer(data, dtype=_DTYPES[code], offset=1 + 4 * dimensions).reshape(shape).copy()


_encoder = msgspec.msgpack.Encoder(enc_hook=_pack)
_decoders: dict[Any, msgspec.msgpack.Decoder[Any]] = {}
_MALFORMED = (msgspec.DecodeError, ValueError, struct.error, RecursionError)
"""What decoding raises for bytes that are no message; the last for absurdly deep nesting."""


class _Header(msgspec.Struct):
    version: int


def encode(message: Message, key: str) -> bytes:
    """The message as bytes, to be said under ``key``."""
    return seal(_encoder.encode(message), key)


def seal(body: bytes, key: str) -> bytes:
    """``body`` behind the CRC-32 of ``key`` and itself, little-endian."""
    return _CHECKSUM.pack(_checksum(body, key)) + body


def _checksum(body: bytes | memoryview, key: str) -> int:
    return zlib.crc32(body, zlib.crc32(key.encode()))


def decode(data: bytes, kind: type[M], key: str) -> M:
    """The message in ``data``, which must be of type ``kind`` (a message, or a union of tagged ones).

    Args:
        data: What came.
        kind: What is expected.
        key: The key under which it came.

    Raises:
        MessageError: The bytes are damaged or were said under another key, for instance in another run; or they are no
            such message, or one of another protocol version.
    """
    decoder = _decoders.get(kind)
    if decoder is None:
        decoder = _decoders[kind] = msgspec.msgpack.Decoder(kind, ext_hook=_unpack)
    name = getattr(kind, "__name__", str(kind))
    body = memoryview(data)[_CHECKSUM.size :]
    if len(data) < _CHECKSUM.size or _CHECKSUM.unpack_from(data)[0] != _checksum(body, key):
        raise MessageError(
            f"not a {name}: its checksum does not fit; it is damaged, or of another run, sender or topic"
        )
    try:
        message: M = decoder.decode(body)
    except _MALFORMED as error:
        _check_version(body, name)
        raise MessageError(f"not a {name}: {error}") from error
    version = getattr(message, "version", PROTOCOL_VERSION)
    if version != PROTOCOL_VERSION:
        raise _version_error(name, version)
    return message


def _check_version(body: memoryview, name: str) -> None:
    """Raise the clearer error when what does not fit is of another version anyway."""
    try:
        version = msgspec.msgpack.decode(body, type=_Header).version
    except _MALFORMED:
        return
    if version != PROTOCOL_VERSION:
        raise _version_error(name, version)


def _version_error(name: str, version: object) -> MessageError:
    return MessageError(
        f"{name} of protocol version {version}, but this process speaks version {PROTOCOL_VERSION}: "
        f"run the same release of coheft everywhere"
    )


def is_finite(array: Array) -> bool:
    """Whether all numbers of an array are."""
    # The sum of squares is so nearly always: one pass instead of three. It may overflow though no number has.
    return math.isfinite(np.vdot(array, array)) or bool(np.isfinite(array).all())


def check_array(array: Array, shape: tuple[int, ...], name: str) -> None:
    """Check an array that came over the wire.

    Raises:
        MessageError: Its shape is not ``shape``, or a number in it is not finite.
    """
    if array.shape != shape:
        raise MessageError(f"{name}.shape is {array.shape} but expected {shape}")
    if not is_finite(array):
        count = int(np.size(array) - np.isfinite(array).sum())
        raise MessageError(f"{name} holds {count} numbers that are not finite")


def check_field(name: str, found: object, expected: object) -> None:
    """Check a field of a message that came over the wire.

    Raises:
        MessageError: It is not what is expected here.
    """
    if found != expected:
        raise MessageError(f"{name} is {found!r} but expected {expected!r}")


def check_choice(name: str, found: object, choices: Collection[object]) -> None:
    """Check that a field of a message that came over the wire is one of those that it can be.

    Raises:
        MessageError: It is another.
    """
    if found not in choices:
        raise MessageError(f"{name} is {found!r} but expected one of {', '.join(map(repr, choices))}")
