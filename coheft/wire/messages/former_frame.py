"""Format of messages up to protocol version 5, which is found in old recordings but not on links.

A checksum, then MessagePack: a map of all fields including the version, with arrays as extension types.
"""

import struct
import zlib
from typing import Any, TypeVar

import msgspec
import numpy as np
import numpy.typing as npt

from coheft.errors import MessageError
from coheft.wire.messages.frame import CHECKSUM, DTYPES, is_map
from coheft.wire.messages.kind import MALFORMED
from coheft.wire.messages.structs import Message

LAST_VERSION = 5

M = TypeVar("M", bound=Message)


def is_former(data: bytes) -> bool:
    """Whether the bytes begin as messages without a header do."""
    return len(data) > CHECKSUM.size and is_map(data[CHECKSUM.size])


def decode_former(data: bytes, kind: type[M], key: str) -> M:
    """Decode a message in this format, or raise a ``MessageError`` that says what else it is."""
    body = data[CHECKSUM.size :]
    if CHECKSUM.unpack_from(data)[0] != zlib.crc32(body, zlib.crc32(key.encode())):
        raise MessageError(f"not a {kind.__name__}: its checksum is wrong")
    try:
        fields = msgspec.msgpack.decode(body)
        if (version := fields.pop("version", LAST_VERSION)) != LAST_VERSION:
            raise MessageError(
                f"{kind.__name__} of protocol version {version!r}, but only {LAST_VERSION} and later are read"
            )
        return msgspec.msgpack.decode(msgspec.msgpack.encode(fields), type=kind, ext_hook=_array)
    except MALFORMED as error:
        raise MessageError(f"not a {kind.__name__}: {error}") from error


def _array(code: int, data: memoryview) -> npt.NDArray[Any]:
    if code not in DTYPES or not data:
        raise ValueError(f"an extension of type {code} is not an array")
    dimensions = data[0]
    shape = struct.unpack_from(f"<{dimensions}I", data, 1)
    return np.frombuffer(data, dtype=DTYPES[code], offset=1 + 4 * dimensions).reshape(shape).copy()
