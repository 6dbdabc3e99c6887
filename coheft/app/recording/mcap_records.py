"""The records of an MCAP file one after the other, also of one that was not finished."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from typing import BinaryIO

import zstandard
from mcap.exceptions import McapError
from mcap.records import McapRecord
from mcap.stream_reader import StreamReader

from coheft.errors import RecordingError

MAGIC = b"\x89MCAP0\r\n"
"""With this an MCAP file begins, and ends if it was finished."""
_DAMAGE = (McapError, zstandard.ZstdError, ValueError, struct.error)
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


def read_records(file: BinaryIO) -> Iterator[McapRecord]:
    """The file's records from its start; those in chunks one by one.

    Raises:
        RecordingError: It is cut, or damaged; after all records before that place.
    """
    # What claims to be longer than the file is damaged; without this limit it would be given memory.
    limit = os.fstat(file.fileno()).st_size
    schemas, channels = {0}, set()
    try:
        for record in StreamReader(file, validate_crcs=True, record_size_limit=limit).records:
            match record:
                case Schema():
                    schemas.add(record.id)
                case Channel() if record.schema_id in schemas:
                    channels.add(record.id)
                case Channel() | Message() if getattr(record, "channel_id", None) not in channels:
                    raise ValueError
            yield record
    except _DAMAGE as error:
        raise RecordingError(f"it is cut or damaged before byte {file.tell()}: {error or 'it just ends'}") from error
