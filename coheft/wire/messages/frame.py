"""The frame of each message: a header, its fields, and one block with the numbers of all its arrays.

::

    header, 32 bytes | fields, MessagePack | shapes | zeros | array | zeros | array | zeros ...

Each array begins at a multiple of 16 bytes. ``docs/wire.md`` describes the format byte by byte.
"""

import math
import struct
import zlib
from collections.abc import Iterable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from coheft.errors import MessageError

PROTOCOL_VERSION = 6
"""Version in each header, which must be equal on both sides. Up to version 5 there were no headers."""
HEADER = struct.Struct("<IBBHIIqq")
"""KeyChecksum, version, kind, size of the shapes [4 B], run, size of the fields [B], block, number; see ``Frame``."""
CHECKSUM = struct.Struct("<I")
AnyArray = npt.NDArray[Any]
Place = tuple[np.dtype[Any], tuple[int, ...], int]
"""Type and shape of an array, and its offset in the block of all arrays of its message [B]."""
DTYPES: dict[int, np.dtype[Any]] = {1: np.dtype("<f8"), 2: np.dtype("<f4"), 3: np.dtype("<i4"), 4: np.dtype("<i8")}
"""Types of arrays, by code; arrays of other types are sent in double precision."""
CODES = {dtype: code for code, dtype in DTYPES.items()}
DOUBLE = DTYPES[1]
MAX_DIMENSIONS = 4
_WORD = 4  # size of the integers that encode shapes [B]
_ALIGNMENT = 16
_ZEROS = [bytes(size) for size in range(_ALIGNMENT)]
_MAPS = (*range(0x80, 0x90), 0xDE, 0xDF)
"""Bytes with which MessagePack may begin a map, as messages without a header did after their checksum."""


class Frame(NamedTuple):
    """A message whose checksum and header are valid for the key under which it was received.

    Attributes:
        code: Code of its kind.
        block, number: Two of its numbers; 0 if its kind has none, see ``Message``.
        fields: All fields except arrays.
        shapes: Types and shapes of its arrays.
        arrays: Contents of its arrays.
    """

    code: int
    block: int
    number: int
    fields: bytes
    shapes: bytes
    arrays: memoryview


class KeyChecksum:
    """Checksums that belong to one key.

    Attributes:
        run: CRC-32 of the run's name, with which the key begins.
        seed: CRC-32 of the key, the initial value of the checksum of messages under it.
    """

    def __init__(self, key: str) -> None:
        self.run, self.seed = zlib.crc32(key.partition("/")[0].encode()), zlib.crc32(key.encode())

    def wrapped(
        self, code: int, block: int, number: int, fields: bytes, shapes: bytes, arrays: Iterable[AnyArray]
    ) -> bytes:
        """Return a message as bytes, see ``Frame``; arrays have to be little-endian."""
        header = HEADER.pack(0, PROTOCOL_VERSION, code, len(shapes) // _WORD, self.run, len(fields), block, number)
        parts = [header[CHECKSUM.size :], fields, shapes, _ZEROS[-(len(fields) + len(shapes)) % _ALIGNMENT]]
        for array in arrays:
            data = array.tobytes()
            parts += data, _ZEROS[-len(data) % _ALIGNMENT]
        return self.close(b"".join(parts))

    def close(self, body: bytes) -> bytes:
        """Return ``body`` with its checksum in front."""
        return CHECKSUM.pack(zlib.crc32(body, self.seed)) + body

    def unwrapped(self, data: bytes, name: str) -> Frame:
        """Return the parts of a message; ``MessageError`` if it is damaged, of another key, or another version."""
        view = memoryview(data)
        if len(data) < CHECKSUM.size or CHECKSUM.unpack_from(data)[0] != zlib.crc32(view[CHECKSUM.size :], self.seed):
            raise MessageError(
                f"not a {name}: its checksum is wrong; it is damaged, or from another run, sender or topic"
            )
        if len(data) > CHECKSUM.size and (version := data[CHECKSUM.size]) != PROTOCOL_VERSION:
            found = f"{PROTOCOL_VERSION - 1} or older" if is_map(version) else version
            raise MessageError(
                f"not a {name}: it has protocol version {found}, but this process uses version "
                f"{PROTOCOL_VERSION}: run the same release of coheft on all hosts"
            )
        if len(data) < HEADER.size:
            raise MessageError(
                f"not a {name}: it has {len(data)} bytes but expected at least {HEADER.size}, the size of the header"
            )
        _, _, code, words, run, size, block, number = HEADER.unpack_from(data)
        if run != self.run:
            raise MessageError(f"not a {name}: its header has run {run:08x} but expected {self.run:08x}")
        first = HEADER.size + size
        end = first + words * _WORD
        if len(data) < (begin := _padded(end)):
            raise MessageError(
                f"not a {name}: it has {len(data)} bytes but expected at least {begin} for the header, {size} of "
                f"fields and {words * _WORD} of shapes"
            )
        return Frame(code, block, number, data[HEADER.size : first], data[first:end], view[begin:])


def is_map(byte: int) -> bool:
    """Whether MessagePack may begin a map with this byte; no header has it as its version."""
    return byte in _MAPS


def _padded(size: int) -> int:
    """Return a size or offset, rounded up to the alignment."""
    return size + -size % _ALIGNMENT


def described(arrays: Iterable[AnyArray]) -> bytes:
    """Encode types and shapes as words: for each array its type, its number of dimensions, and its dimensions."""
    words: list[int] = []
    for array in arrays:
        words += CODES[array.dtype], array.ndim, *array.shape
    return struct.pack(f"<{len(words)}I", *words)


def _places_of(shapes: bytes) -> tuple[list[Place], int]:
    words = struct.unpack(f"<{len(shapes) // _WORD}I", shapes)
    places: list[Place] = []
    at = end = 0
    while at < len(words):
        code, dimensions = words[at], words[at + 1] if at + 1 < len(words) else 0
        shape = words[at + 2 : at + 2 + dimensions]
        if code not in DTYPES or dimensions > MAX_DIMENSIONS or at + 2 + dimensions > len(words):
            raise ValueError(f"expected arrays of types 1 to {len(DTYPES)} and at most {MAX_DIMENSIONS} dimensions")
        places.append((DTYPES[code], shape, end))
        end += _padded(DTYPES[code].itemsize * math.prod(shape))
        at += 2 + dimensions
    return places, end


_known = lru_cache(maxsize=256)(_places_of)
_SHORT = 512


def places_of(shapes: bytes) -> tuple[list[Place], int]:
    """Decode what ``described`` has encoded, and the size of all arrays [B]; ``ValueError`` if it is something else."""
    return _known(shapes) if len(shapes) <= _SHORT else _places_of(shapes)
