"""What topics and types a file has: without these, its messages mean nothing, so recordings have copies of them.

A chunk defines the topics of which it has the first message. If it is damaged, a copy tells what those of later
chunks are: an attachment whose content is the records themselves.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from mcap.data_stream import RecordBuilder
from mcap.records import Attachment, Channel, Chunk, Header, McapRecord, Schema
from mcap.stream_reader import breakup_chunk

from coheft.app.recording.mcap_records import DAMAGE
from coheft.app.recording.pieces import Loss, Piece

COPY = "definitions.mcap"
"""Name of the attachments."""


def to_copy(records: Iterable[McapRecord]) -> bytes:
    """The content of an attachment."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())


def _from_copy(data: bytes) -> list[McapRecord]:
    try:
        return list(breakup_chunk(Chunk("", data, 0, 0, 0, len(data))))
    except DAMAGE:
        return []


@dataclass
class Definitions:
    """What all sound pieces of a file say about it; what has a checksum counts more than what has none.

    Attributes:
        header: How the file was made.
        schemas: Types, by number.
        channels: Topics, by number.
    """

    header: Header = field(default_factory=lambda: Header("", ""))
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)

    @classmethod
    def of(cls, pieces: Iterable[Piece | Loss]) -> Definitions:
        """Those of a file."""
        sealed, others = cls(), cls()
        for piece in pieces:
            if isinstance(piece, Piece):
                for record in piece.records:
                    (sealed if piece.is_sealed else others)._note(record)
        return cls(others.header, others.schemas | sealed.schemas, others.channels | sealed.channels)

    def _note(self, record: McapRecord) -> None:
        match record:
            case Header():
                self.header = record
            case Schema():
                self.schemas.setdefault(record.id, record)
            case Channel():
                self.channels.setdefault(record.id, record)
            case Attachment(name=name) if name == COPY:
                for each in _from_copy(record.data):
                    self._note(each)
            case _:
                pass
