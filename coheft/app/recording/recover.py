"""Recovery of incomplete or damaged recordings."""

import math
import mmap
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from mcap.records import Attachment, Channel, Chunk, Header, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import breakup_chunk
from mcap.writer import Writer

from coheft.app.recording.mcap_file import COPY, make_writer
from coheft.app.recording.mcap_records import DAMAGE, MAGIC
from coheft.app.recording.pieces import Lost, is_whole, pieces
from coheft.errors import RecordingError

_MAGIC_MATCHES = 5
"""Number of correct bytes of the magic number with which a file counts as a damaged MCAP file."""


@dataclass(frozen=True)
class Saved:
    """Result of a recovery.

    Attributes:
        messages: Number of saved messages.
        until: Latest time of the run in them [s].
        lost: Parts that could not be saved, in order.
        nameless: Number of messages that could not be saved because the definitions of their topics are lost.
    """

    messages: int
    until: float
    lost: tuple[Lost, ...] = ()
    nameless: int = 0


def recover(path: Path, output: Path, *, overwrite: bool = False) -> Saved | None:
    """Write the undamaged content of an incomplete or damaged MCAP file to a new, complete one; None if it is complete.

    The old file is not changed, unless it is also the output. The output appears only when it is complete.

    Raises:
        RecordingError: It cannot be read, contains no messages that could be saved, or the output cannot be written.
    """
    if output.exists() and not overwrite:
        raise RecordingError(f"{output} exists already: give another name with --output, or add --overwrite")
    part = output.with_name(f"{output.name}.part")
    try:
        with _content(path) as content:
            if is_whole(content):
                return None
            with part.open("wb") as new:
                saved = _copy(content, make_writer(new))
        part.replace(output)
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error
    except OSError as error:
        raise RecordingError(f"{error.filename or part}: {error.strerror}") from error
    finally:
        part.unlink(missing_ok=True)
    return saved


@contextmanager
def _content(path: Path) -> Iterator[bytes]:
    """Map the content of an MCAP file into memory."""
    with path.open("rb") as file:
        begin = file.read(len(MAGIC))
        if not begin:
            raise RecordingError("it is empty")
        if sum(one == other for one, other in zip(begin, MAGIC, strict=False)) < _MAGIC_MATCHES:
            raise RecordingError("it is not an MCAP file")
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            yield content  # type: ignore[misc]  # it can be sliced like bytes


def _copy(content: bytes, writer: Writer) -> Saved:
    channels = _define(content, writer)
    count, nameless, latest = 0, 0, -math.inf
    lost: list[Lost] = []
    for piece in pieces(content):
        if isinstance(piece, Lost):
            if lost and lost[-1].end == piece.start:
                lost[-1] = replace(lost[-1], end=piece.end)
            else:
                lost.append(replace(piece, after=latest))
            continue
        times = [record.log_time / 1e9 for record in piece.records if isinstance(record, Message)]
        if times:
            lost = [replace(each, before=min(each.before, *times)) for each in lost]
            latest = max(latest, *times)
        for record in piece.records:
            match record:
                case Message() if record.channel_id not in channels:
                    nameless += 1
                case Message():
                    count += 1
                    channel, time = channels[record.channel_id], record.log_time
                    writer.add_message(channel, time, record.data, record.publish_time, record.sequence)
                case Attachment() if record.name != COPY:  # the new file needs no copy of its definitions
                    writer.add_attachment(
                        record.create_time, record.log_time, record.name, record.media_type, record.data
                    )
                case Metadata():
                    writer.add_metadata(record.name, record.metadata)
    if count == 0:
        raise RecordingError("it contains no message that could be saved")
    writer.finish()
    return Saved(count, latest, tuple(lost), nameless)


def _define(content: bytes, writer: Writer) -> dict[int, int]:
    """Write the definitions of topics and types; return the new number of each topic, by the old one.

    A chunk defines the topics whose first messages it contains. If it is damaged, a copy of the definitions replaces
    it. Records with a checksum take precedence.
    """
    header = Header("", "")
    found: dict[tuple[type[McapRecord], int], McapRecord] = {}
    for piece in pieces(content):
        if isinstance(piece, Lost):
            continue
        for record in _with_copied(piece.records):
            match record:
                case Header():
                    header = record
                case Schema() | Channel() if piece.is_sealed or (type(record), record.id) not in found:
                    found[type(record), record.id] = record
    writer.start(header.profile, header.library)
    schemas = {0: 0} | {
        schema.id: writer.register_schema(schema.name, schema.encoding, schema.data)
        for schema in found.values()
        if isinstance(schema, Schema)
    }
    return {
        each.id: writer.register_channel(each.topic, each.message_encoding, schemas[each.schema_id], each.metadata)
        for each in found.values()
        if isinstance(each, Channel) and each.schema_id in schemas
    }


def _with_copied(records: list[McapRecord]) -> Iterator[McapRecord]:
    for record in records:
        yield record
        if isinstance(record, Attachment) and record.name == COPY:
            with suppress(*DAMAGE):
                yield from breakup_chunk(Chunk("", record.data, 0, 0, 0, len(record.data)))
