"""The undamaged pieces of an MCAP file, including those after damage.

Chunks and attachments have checksums: after damage, reading continues at the next one whose checksum is right. Chunks
contain their own length, so damage right before one does not hide it. Every other record is used if it can be read.
"""

import math
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
"""Head of each record: its type and length [bytes]."""
_CHUNK_HEAD = struct.Struct("<QQQII")
"""Head of a chunk: begin, end, size, checksum, length of the compression's name."""
_NAME_LIMIT = 16
"""No name of a compression is longer."""
_FIRST_UNKNOWN = 0x10
"""Readers skip types of records from here on, which they do not know."""
# The start of a chunk or an attachment of less than 4 GiB.
_MAY_BE_SEALED = re.compile(rb"(?=[\x06\x09].{4}\x00{4})", re.DOTALL)


@dataclass(frozen=True)
class Piece:
    """An undamaged piece of a file, with its first and last offset [bytes].

    Attributes:
        records: All records of a chunk, or a single record.
        is_sealed: Whether it has a checksum, which is right.
    """

    start: int
    end: int
    records: list[McapRecord]
    is_sealed: bool = False


@dataclass(frozen=True)
class Lost:
    """A part of a file that could not be saved, with its first and last offset [bytes].

    Attributes:
        after: Latest time of the run before it [s]; -inf if there is none.
        before: Earliest time of the run after it [s]; inf if there is none.
    """

    start: int
    end: int
    after: float = -math.inf
    before: float = math.inf


def pieces(content: bytes) -> Iterator[Piece | Lost]:
    """Yield all pieces of a file in order, without the magic bytes at both ends; times of lost ones are not set.

    The content can be anything that is sliced like bytes, so that it need not be in memory.
    """
    place = len(MAGIC)
    while place < len(content) and not _is_end(content, place):
        yield (found := _piece_at(content, place) or Lost(place, _next_place(content, place)))
        place = found.end


def is_whole(content: bytes) -> bool:
    """Whether a file is complete and undamaged, as far as it has checksums; ours have all possible ones."""
    if content[-len(MAGIC) :] != MAGIC:
        return False
    last: McapRecord | None = None
    for piece in pieces(content):
        if isinstance(piece, Lost):
            return False
        last = piece.records[-1] if piece.records else None
        match last:
            case DataEnd() if last.data_section_crc not in (0, _checksum(content, 0, piece.start)):
                return False
            case Footer():
                start = last.summary_start or piece.start
                if last.summary_crc not in (0, _checksum(content, start, piece.end - 4)):  # without itself
                    return False
    return isinstance(last, Footer)


def _checksum(content: bytes, start: int, end: int) -> int:
    with memoryview(content) as whole:
        return zlib.crc32(whole[start:end])


def _is_end(content: bytes, place: int) -> bool:
    return place == len(content) - len(MAGIC) and content[place:] == MAGIC


def _piece_at(content: bytes, place: int) -> Piece | None:
    """Return the record that begins at an offset; None if there is no undamaged one.

    A record without a checksum may have lost its end: then it contains the start of a sealed piece.
    """
    found = _readable_at(content, place)
    is_right = found is None or found.is_sealed or _next_sealed(content, place + 1, found.end) is None
    return found if is_right else None


def _next_sealed(content: bytes, start: int, end: int) -> int | None:
    """Return where the first sealed piece between two offsets begins; None if there is none."""
    for match in _MAY_BE_SEALED.finditer(content, start, min(end + _HEAD.size - 1, len(content))):
        piece = _readable_at(content, match.start())
        if piece is not None and piece.is_sealed:
            return piece.start
    return None


def _readable_at(content: bytes, place: int) -> Piece | None:
    """Return the record at an offset, if it can be read and has no wrong checksum."""
    if place + _HEAD.size > len(content):
        return None
    opcode, length = _HEAD.unpack(content[place : place + _HEAD.size])
    end = place + _HEAD.size + length
    found = _single(content, opcode, place, end) if opcode != Opcode.CHUNK and end <= len(content) else None
    return found or _chunk(content, place, end if opcode == Opcode.CHUNK else None)


def _single(content: bytes, opcode: int, place: int, end: int) -> Piece | None:
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
    """Return a chunk with a correct checksum, even if the head before it is damaged.

    ``end`` is its end according to that head; None if the head is not that of a chunk.
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
    """Return where to continue: after the damaged record if its length is right, or else at a sealed piece."""
    sealed = _next_sealed(content, place + 1, len(content))
    if place + _HEAD.size <= len(content):
        behind: int = place + _HEAD.size + _HEAD.unpack(content[place : place + _HEAD.size])[1]
        is_near = behind <= (len(content) if sealed is None else sealed)
        if is_near and (behind == len(content) or _piece_at(content, behind)):
            return behind
    if sealed is not None:
        return sealed
    at_end = len(content) - len(MAGIC)
    return at_end if place < at_end and _is_end(content, at_end) else len(content)


class _Strict(ReadDataStream):  # type: ignore[misc]  # mcap has no types
    """A stream that raises ``EndOfFile`` instead of returning less than requested."""

    def read(self, length: int) -> bytes:
        data: bytes = super().read(length)
        if len(data) < length:
            raise EndOfFile
        return data
