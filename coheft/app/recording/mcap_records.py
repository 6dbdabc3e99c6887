"""The records of an MCAP file one after the other, also of one that was not finished."""

from __future__ import annotations

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
"""With this an MCAP file begins, and ends if it was finished."""
DAMAGE = (McapError, zstandard.ZstdError, ValueError, struct.error, OverflowError, MemoryError)
"""What the library raises for a file that is cut or damaged."""


def is_finished(file: BinaryIO) -> bool:
    """Whether an MCAP file has an end; leaves the file at its start.

    Raises:
        RecordingError: It is no MCAP file.
    """
    start = file.read(len(MAGIC))
    if start != MAGIC:
        raise RecordingError("it is no MCAP file" if start else "it is empty")
    size = file.seek(0, os.SEEK_END)
    file.seek(max(len(MAGIC), size - len(MAGIC)))
    end = file.read()
    file.seek(0)
    return end == MAGIC


class DamagedError(RecordingError):
    """An MCAP file is cut or damaged."""


class _Bounded:
    """A file of which no more is asked than it holds: damaged lengths would be given memory."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._left = os.fstat(file.fileno()).st_size

    def read(self, length: int) -> bytes:
        data = self._file.read(min(length, self._left))
        self._left -= len(data)
        return data


def read_records(file: BinaryIO) -> Iterator[McapRecord]:
    """The file's records from its start; those in chunks one by one.

    Raises:
        DamagedError: It is cut, or damaged; after all records before that place.
    """
    schemas, channels = {0}, set[int]()
    try:
        for record in StreamReader(_Bounded(file), validate_crcs=True, record_size_limit=None).records:
            match record:
                case Schema():
                    schemas.add(record.id)
                case Channel() if record.schema_id not in schemas:
                    raise ValueError(f"topic {record.topic!r} is of no known type")
                case Channel():
                    channels.add(record.id)
                case Message() if record.channel_id not in channels:
                    raise ValueError("a message is of no known topic")
            yield record
    except DAMAGE as error:
        reason = str(error) or "it just ends"
        raise DamagedError(f"it is cut or damaged before byte {file.tell()}: {reason}") from error
