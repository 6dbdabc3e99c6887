"""The sound pieces of an MCAP file, whatever has become of the others: damage is not taken for the end.

Chunks and attachments have checksums, and tell their own length inside, so they are found even when what stands before
them is damaged. Everything else is taken if it can be read, and what follows it looks like a record.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO

from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Attachment, Chunk, DataEnd, Footer, McapRecord, Message
from mcap.stream_reader import breakup_chunk

from coheft.app.recording.mcap_records import DAMAGE, MAGIC

_HEAD = struct.Struct("<BQ")
"""Of each record: what it is, and how long [bytes]."""
_CHUNK_HEAD = struct.Struct("<QQQII")
"""Begin, end, size, checksum, and the length of the compression's name."""
_NAME_LIMIT = 16
"""No compression has a longer name."""
_FIRST_UNKNOWN = 0x10
"""From here on, readers skip what they do not know."""
# No record is longer than 4 GiB.
_LOOKS_LIKE_HEAD = re.compile(rb"(?=[\x01-\x0f].{4}\x00{4})", re.DOTALL)
_CHAIN = 4
"""So many records in a row are no coincidence."""
_READERS: dict[int, Callable[[ReadDataStream], McapRecord]] = {
    Opcode.HEADER: records.Header.read,
    Opcode.FOOTER: records.Footer.read,
    Opcode.SCHEMA: records.Schema.read,
    Opcode.CHANNEL: records.Channel.read,
    Opcode.MESSAGE_INDEX: records.MessageIndex.read,
    Opcode.CHUNK_INDEX: records.ChunkIndex.read,
    Opcode.ATTACHMENT: records.Attachment.read,
    Opcode.ATTACHMENT_INDEX: records.AttachmentIndex.read,
    Opcode.STATISTICS: records.Statistics.read,
    Opcode.METADATA: records.Metadata.read,
    Opcode.METADATA_INDEX: records.MetadataIndex.read,
    Opcode.SUMMARY_OFFSET: records.SummaryOffset.read,
    Opcode.DATA_END: records.DataEnd.read,
}


@dataclass(frozen=True)
class Piece:
    """What stands between two places of a file, and is sound.

    Attributes:
        start: Where it begins [bytes].
        end: Where it ends [bytes].
        records: All records of a chunk, or one that stands alone, or none that is known.
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
    if content[:place] != MAGIC:
        yield Loss(0, place)
    while place < len(content) and not _is_end(content, place):
        found = _piece_at(content, place)
        if found is not None and (found.is_sealed or _may_begin(content, found.end)):
            yield found
            place = found.end
            continue
        after = _next_place(content, place)
        if found is not None and found.end <= after:  # else it reaches into what follows: some of it is missing
            yield found
            place = found.end
        if place < after:
            yield Loss(place, after)
        place = after


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
    """What begins there; None: nothing that is sound."""
    if place + _HEAD.size > len(content):
        return None
    opcode, length = _HEAD.unpack(content[place : place + _HEAD.size])
    end = place + _HEAD.size + length
    if opcode != Opcode.CHUNK and end <= len(content) and (single := _single(content, opcode, place, end)):
        return single
    return _chunk(content, place, end if opcode == Opcode.CHUNK else None)


def _single(content: bytes, opcode: int, place: int, end: int) -> Piece | None:
    """A record that is no chunk."""
    if opcode >= _FIRST_UNKNOWN:
        return Piece(place, end, []) if _may_begin(content, end) else None
    body = content[place + _HEAD.size : end]
    stream = _Strict(BytesIO(body))
    try:
        if opcode == Opcode.MESSAGE:
            record: McapRecord = Message.read(stream, len(body))
        elif opcode in _READERS:
            record = _READERS[opcode](stream)
        else:
            return None
    except DAMAGE:
        return None
    if isinstance(record, Attachment):
        checksum = int.from_bytes(body[-4:], "little")
        is_right = checksum in (0, zlib.crc32(body[:-4])) and stream.count == len(body)
        return Piece(place, end, [record], is_sealed=checksum != 0) if is_right else None
    is_as_long_as_it_says = opcode != Opcode.MESSAGE and stream.count == len(body)
    return Piece(place, end, [record]) if is_as_long_as_it_says or _may_begin(content, end) else None


def _chunk(content: bytes, place: int, end: int | None) -> Piece | None:
    """A chunk whose checksum fits, even if what stands before it is damaged.

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
        _, length = _HEAD.unpack(content[place : place + _HEAD.size])
        behind: int = place + _HEAD.size + length
        if behind == len(content) or (behind < len(content) and _are_there(content, behind, 2)):
            return behind
    for match in _LOOKS_LIKE_HEAD.finditer(content, place + 1):
        piece = _piece_at(content, match.start())
        if piece is not None and (piece.is_sealed or _are_there(content, piece.start, _CHAIN)):
            return piece.start
    at_end = len(content) - len(MAGIC)
    return at_end if place < at_end and _is_end(content, at_end) else len(content)


def _are_there(content: bytes, place: int, count: int) -> bool:
    """Whether so many sound pieces, or one with a checksum, or all until the end, begin there."""
    for _ in range(count):
        if place == len(content) or _is_end(content, place):
            return True
        piece = _piece_at(content, place)
        if piece is None:
            return False
        if piece.is_sealed:
            return True
        place = piece.end
    return True


def _may_begin(content: bytes, place: int) -> bool:
    """Whether a record may begin there, which may be cut, or the file may end."""
    if place + _HEAD.size > len(content) or _LOOKS_LIKE_HEAD.match(content, place):
        return True
    opcode, length = _HEAD.unpack(content[place : place + _HEAD.size])
    end: int = place + _HEAD.size + length
    if opcode < _FIRST_UNKNOWN or end > len(content):
        return False
    return end == len(content) or _LOOKS_LIKE_HEAD.match(content, end) is not None


class _Strict(ReadDataStream):  # type: ignore[misc]  # mcap has no types
    """Gives no less than it is asked for."""

    def read(self, length: int) -> bytes:
        data: bytes = super().read(length)
        if len(data) < length:
            raise EndOfFile
        return data
