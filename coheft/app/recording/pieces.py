"""The sound pieces of an MCAP file, whatever has become of the others: damage is not taken for the end.

Chunks and attachments have checksums: behind damage, reading goes on at the next one whose checksum fits. Chunks tell
their own length inside, so damage right before one does not hide it. Every other record is taken if it can be read.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Attachment, Chunk, DataEnd, Footer, McapRecord
from mcap.stream_reader import StreamReader, breakup_chunk

from coheft.app.recording.mcap_records import DAMAGE, MAGIC

_HEAD = struct.Struct("<BQ")
"""Of each record: what it is, and how long [bytes]."""
_CHUNK_HEAD = struct.Struct("<QQQII")
"""Begin, end, size, checksum, and the length of the compression's name."""
_NAME_LIMIT = 16
"""No compression has a longer name."""
_FIRST_UNKNOWN = 0x10
"""From here on, readers skip what they do not know."""
# A chunk or an attachment, of less than 4 GiB.
_MAY_BE_SEALED = re.compile(rb"(?=[\x06\x09].{4}\x00{4})", re.DOTALL)


@dataclass(frozen=True)
class Piece:
    """What stands between two places of a file, and is sound.

    Attributes:
        start: Where it begins [bytes].
        end: Where it ends [bytes].
        records: All records of a chunk, or one that stands alone.
        is_sealed: Whether its checksum fits.
    """

    start: int
    end: int
    records: list[McapRecord]
    is_sealed: bool = False


@dataclass(frozen=True)
class Loss:
    """What stands between two places of a file [bytes], and is not sound."""

    start: int
    end: int


def pieces(content: bytes) -> Iterator[Piece | Loss]:
    """All that a file holds, in its order, but for the magic bytes at both ends.

    Args:
        content: Of the file; anything that can be sliced like bytes, so that it need not be in memory.
    """
    place = len(MAGIC)
    while place < len(content) and not _is_end(content, place):
        found = _piece_at(content, place) or Loss(place, _next_place(content, place))
        yield found
        place = found.end


def is_whole(content: bytes) -> bool:
    """Whether nothing of a file is damaged or missing, as far as it has checksums: ours have all that there are."""
    if content[-len(MAGIC) :] != MAGIC:
        return False
    last: McapRecord | None = None
    for piece in pieces(content):
        if isinstance(piece, Loss):
            return False
        last = piece.records[-1] if piece.records else None
        match last:
            case DataEnd() if last.data_section_crc not in (0, _checksum(content, 0, piece.start)):
                return False
            case Footer():
                start = last.summary_start or piece.start
                if last.summary_crc not in (0, _checksum(content, start, piece.end - 4)):  # its own bytes
                    return False
            case _:
                pass
    return isinstance(last, Footer)


def _checksum(content: bytes, start: int, end: int) -> int:
    with memoryview(content) as whole:
        return zlib.crc32(whole[start:end])


def _is_end(content: bytes, place: int) -> bool:
    return place == len(content) - len(MAGIC) and content[place:] == MAGIC


def _piece_at(content: bytes, place: int) -> Piece | None:
    """The record that begins there; None: none that is sound."""
    if place + _HEAD.size > len(content):
        return None
    opcode, length = _HEAD.unpack(content[place : place + _HEAD.size])
    end = place + _HEAD.size + length
    found = _single(content, opcode, place, end) if opcode != Opcode.CHUNK and end <= len(content) else None
    return found or _chunk(content, place, end if opcode == Opcode.CHUNK else None)


def _single(content: bytes, opcode: int, place: int, end: int) -> Piece | None:
    """A record that is no chunk."""
    if opcode >= _FIRST_UNKNOWN:
        return None
    try:
        if opcode == Opcode.ATTACHMENT:
            body = content[place + _HEAD.size : end]
            checksum = int.from_bytes(body[-4:], "little")
            is_right = checksum in (0, zlib.crc32(body[:-4]))
            attachment = Attachment.read(_Strict(BytesIO(body)))
            return Piece(place, end, [attachment], checksum != 0) if is_right else None
        record = StreamReader(_Strict(BytesIO(content[place:end])), skip_magic=True, record_size_limit=None)
        return Piece(place, end, [next(record.records)])
    except (*DAMAGE, StopIteration):
        return None


def _chunk(content: bytes, place: int, end: int | None) -> Piece | None:
    """A chunk whose checksum fits, even if the head before it is damaged.

    Args:
        content: Of the file.
        place: Where it begins.
        end: Where it ends if its head is right; None: it is not that of a chunk.
    """
    body = place + _HEAD.size
    start = body + _CHUNK_HEAD.size
    if start > len(content):
        return None
    *_, checksum, name = _CHUNK_HEAD.unpack(content[body:start])
    data = start + name + 8
    if name > _NAME_LIMIT or data > len(content):
        return None
    own_end = data + int.from_bytes(content[data - 8 : data], "little")
    if own_end > len(content) or (not checksum and own_end != end):
        return None
    try:
        chunk = Chunk.read(_Strict(BytesIO(content[body:own_end])))
        return Piece(place, own_end, breakup_chunk(chunk, validate_crc=True), is_sealed=checksum != 0)
    except DAMAGE:
        return None


def _next_place(content: bytes, place: int) -> int:
    """Where to go on after damage: behind what is damaged if its length is right, or else at what is surely sound."""
    if place + _HEAD.size <= len(content):
        behind: int = place + _HEAD.size + _HEAD.unpack(content[place : place + _HEAD.size])[1]
        if behind == len(content) or (behind < len(content) and _piece_at(content, behind)):
            return behind
    for match in _MAY_BE_SEALED.finditer(content, place + 1):
        piece = _piece_at(content, match.start())
        if piece is not None and piece.is_sealed:
            return piece.start
    at_end = len(content) - len(MAGIC)
    return at_end if place < at_end and _is_end(content, at_end) else len(content)


class _Strict(ReadDataStream):  # type: ignore[misc]  # mcap has no types
    """Gives no less than it is asked for."""

    def read(self, length: int) -> bytes:
        data: bytes = super().read(length)
        if len(data) < length:
            raise EndOfFile
        return data
