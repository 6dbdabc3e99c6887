"""Iteration over the records of an MCAP file, also of an incomplete one."""

import os
import struct
from collections.abc import Iterator
from typing import BinaryIO

import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader

from coheft.errors import RecordingError

MAGIC = b"\x89MCAP0\r\n"
"""An MCAP file begins with this, and ends with it if it is complete."""
DAMAGE = (McapError, zstandard.ZstdError, ValueError, struct.error, OverflowError, MemoryError)
"""Exceptions that the library raises for an incomplete or damaged file."""


def is_finished(file: BinaryIO) -> bool:
    """Whether an MCAP file, left at its start, is complete; raise ``RecordingError`` if it is none."""
    start = file.read(len(MAGIC))
    if start != MAGIC:
        raise RecordingError("it is not an MCAP file" if start else "it is empty")
    size = file.seek(0, os.SEEK_END)
    file.seek(max(len(MAGIC), size - len(MAGIC)))
    end = file.read()
    file.seek(0)
    return end == MAGIC


class DamagedError(RecordingError):
    """An MCAP file is incomplete or damaged."""


class _Bounded:
    """A file from which no more is read than it contains: memory would be allocated for damaged lengths."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._left = os.fstat(file.fileno()).st_size

    def read(self, length: int) -> bytes:
        data = self._file.read(min(length, self._left))
        self._left -= len(data)
        return data


def read_records(file: BinaryIO) -> Iterator[McapRecord]:
    """Yield the file's records from its start; those in chunks one by one.

    If the file is incomplete or damaged, a ``DamagedError`` follows the records before that place.
    """
    schemas, channels = {0}, set[int]()
    try:
        for record in StreamReader(_Bounded(file), validate_crcs=True, record_size_limit=None).records:
            match record:
                case Schema():
                    schemas.add(record.id)
                case Channel() if record.schema_id not in schemas:
                    raise ValueError(f"topic {record.topic!r} has an unknown type")
                case Channel():
                    channels.add(record.id)
                case Message() if record.channel_id not in channels:
                    raise ValueError("a message has an unknown topic")
            yield record
    except DAMAGE as error:
        reason = str(error) or "unexpected end"
        raise DamagedError(f"it is incomplete or damaged before byte {file.tell()}: {reason}") from error
