"""What each message is wrapped in: a header, its fields, and one block with the numbers of all its arrays.

::

    header, 32 bytes | fields, MessagePack | shapes | zeros | array | zeros | array | zeros ...

Each array begins at a multiple of 16 bytes. ``docs/wire.md`` tells it byte by byte.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy.typing as npt

from coheft.errors import MessageError

PROTOCOL_VERSION = 6
"""It is in each header, and must be equal on both sides. Up to 5 there were no headers."""
HEADER = struct.Struct("<IBBHIIqq")
"""Checksum, version, kind, size of the shapes [4 B], run, size of the fields [B], block, number; see ``Frame``."""
WORD = 4
"""Size of one of the numbers that shapes are made of [B]."""
ALIGNMENT = 16
CHECKSUM = struct.Struct("<I")
_ZEROS = [bytes(size) for size in range(ALIGNMENT)]
_MAPS = (*range(0x80, 0x90), 0xDE, 0xDF)
"""How MessagePack may begin a map: so did messages without a header, behind their checksum."""


class Frame(NamedTuple):
    """A message that is whole, and was said under the key under which it came.

    Attributes:
        code: Of its kind.
        block, number: Two numbers of it; 0 if its kind has none, see ``Message``.
        fields: All else but arrays.
        shapes: Types and shapes of its arrays.
        arrays: What is in its arrays.
    """

    code: int
    block: int
    number: int
    fields: bytes
    shapes: bytes
    arrays: memoryview


class Seal:
    """What is particular to one key.

    Attributes:
        run: CRC-32 of the run's name, with which the key begins.
        seed: CRC-32 of the key: with it begins the checksum of what is said under it.
    """

    def __init__(self, key: str) -> None:
        self.run, self.seed = zlib.crc32(key.partition("/")[0].encode()), zlib.crc32(key.encode())

    def wrapped(
        self, code: int, block: int, number: int, fields: bytes, shapes: bytes, arrays: Iterable[npt.NDArray[Any]]
    ) -> bytes:
        """A message as bytes, see ``Frame``; arrays are little-endian already."""
        words, size = len(shapes) // WORD, len(fields)
        header = HEADER.pack(0, PROTOCOL_VERSION, code, words, self.run, size, block, number)
        parts = [header[CHECKSUM.size :], fields, shapes, _ZEROS[-(size + len(shapes)) % ALIGNMENT]]
        for array in arrays:
            data = array.tobytes()
            parts.append(data)
            if rest := len(data) % ALIGNMENT:
                parts.append(_ZEROS[ALIGNMENT - rest])
        return self.close(b"".join(parts))

    def close(self, body: bytes) -> bytes:
        """``body`` behind its checksum."""
        return CHECKSUM.pack(zlib.crc32(body, self.seed)) + body

    def unwrapped(self, data: bytes, name: str) -> Frame:
        """What is in a message.

        Args:
            data: What came.
            name: What is expected, for errors.

        Raises:
            MessageError: It is damaged, or was said under another key, or by a process of another protocol version.
        """
        view = memoryview(data)
        if len(data) < CHECKSUM.size or CHECKSUM.unpack_from(data)[0] != zlib.crc32(view[CHECKSUM.size :], self.seed):
            raise MessageError(
                f"not a {name}: its checksum does not fit; it is damaged, or of another run, sender or topic"
            )
        if len(data) > CHECKSUM.size and (version := data[CHECKSUM.size]) != PROTOCOL_VERSION:
            found = f"{PROTOCOL_VERSION - 1} or older" if is_map(version) else version
            raise MessageError(
                f"not a {name}: it is of protocol version {found}, but this process speaks version "
                f"{PROTOCOL_VERSION}: run the same release of coheft everywhere"
            )
        if len(data) < HEADER.size:
            raise MessageError(
                f"not a {name}: it has {len(data)} bytes but expected the header's {HEADER.size} at least"
            )
        _, _, code, words, run, size, block, number = HEADER.unpack_from(data)
        if run != self.run:
            raise MessageError(f"not a {name}: its header says run {run:08x} but expected {self.run:08x}")
        first = HEADER.size + size
        end = first + words * WORD
        if len(data) < padded(end):
            raise MessageError(
                f"not a {name}: it has {len(data)} bytes but expected at least {padded(end)}, for a header, {size} of "
                f"fields and {words * WORD} of shapes"
            )
        return Frame(code, block, number, data[HEADER.size : first], data[first:end], view[padded(end) :])


def is_map(byte: int) -> bool:
    """Whether MessagePack may begin a map with this byte: no header has it as its version."""
    return byte in _MAPS


def padded(size: int) -> int:
    """A size, or place, with the zeros that follow."""
    return size + -size % ALIGNMENT
