"""Messages as bytes that other implementations can be tested with: docs/wire.md tells what they are made of.

``wire_vectors.json`` holds what was said once by this protocol version. It changes only with the version.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from coheft.wire.messages import requests, structs
from coheft.wire.messages.codec import decode, encode
from coheft.wire.messages.structs import Message

VECTORS = msgspec.json.decode(Path(__file__).with_name("wire_vectors.json").read_bytes())


def kind_of(vector: dict[str, Any]) -> type[Message]:
    """Of the message."""
    found: type[Message] = getattr(structs, vector["kind"], None) or getattr(requests, vector["kind"])
    return found


def plain(value: Any) -> Any:
    """A message or a part of one, as the vectors have it."""
    match value:
        case np.ndarray():
            return {"type": str(value.dtype), "numbers": value.tolist()}
        case msgspec.Struct():
            return {name: plain(getattr(value, name)) for name in value.__struct_fields__}
        case dict():
            return {name: plain(inner) for name, inner in value.items()}
        case list() | tuple():
            return [plain(inner) for inner in value]
        case bytes():
            return value.hex()
    return value


@pytest.mark.parametrize("vector", VECTORS, ids=[vector["kind"] for vector in VECTORS])
def test_bytes_and_messages_are_those_of_the_vectors(vector: dict[str, Any]) -> None:
    data = bytes.fromhex(vector["bytes"])
    message = decode(data, kind_of(vector), vector["key"])
    assert plain(message) == vector["fields"]
    assert encode(message, vector["key"]) == data


@pytest.mark.parametrize("vector", VECTORS, ids=[vector["kind"] for vector in VECTORS])
def test_bytes_can_be_read_as_the_page_says(vector: dict[str, Any]) -> None:
    """Without anything of ours."""
    data, key = bytes.fromhex(vector["bytes"]), vector["key"].encode()
    checksum, version, code, words, run, size, block, number = struct.unpack_from("<IBBHIIqq", data)
    assert checksum == zlib.crc32(key + data[4:])
    assert version == 6
    assert code == kind_of(vector).code
    assert run == zlib.crc32(key.split(b"/")[0])
    fields, shapes = data[32 : 32 + size], data[32 + size : 32 + size + 4 * words]
    at = -(-(32 + size + 4 * words) // 16) * 16
    left = list(struct.unpack(f"<{words}I", shapes))
    arrays = []
    while left:
        kind, dimensions = left[:2]
        shape, left = left[2 : 2 + dimensions], left[2 + dimensions :]
        dtype = {1: "<f8", 2: "<f4", 3: "<i4", 4: "<i8"}[kind]
        arrays.append(np.frombuffer(data, dtype, int(np.prod(shape)), at).reshape(shape))
        at += -(-arrays[-1].nbytes // 16) * 16
    assert at == len(data)
    taken = iter(arrays)
    found = msgspec.msgpack.decode(fields, ext_hook=lambda code, _: next(taken) if code == 1 else None)
    assert next(taken, None) is None
    in_header = dict(zip(kind_of(vector).in_header, (block, number), strict=True))
    in_header.pop(None, None)
    assert {name: plain(value) for name, value in found.items()} | in_header == vector["fields"]
