"""Saves what there is of a recording that was not finished, or was damaged."""

from __future__ import annotations

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
from coheft.app.recording.pieces import Loss, Piece, is_whole, pieces
from coheft.errors import RecordingError

_ALIKE = 5
"""With so many of its first bytes right, a file is an MCAP file that is damaged there."""


@dataclass(frozen=True)
class Lost:
    """What could not be saved at one place.

    Attributes:
        start: Where it begins in the old file [bytes].
        end: Where it ends [bytes].
        after: What comes before it tells of the run up to here [s]; -inf: nothing does.
        before: What follows it tells of the run from here on [s]; inf: nothing does.
    """

    start: int
    end: int
    after: float
    before: float


@dataclass(frozen=True)
class Saved:
    """What could be saved.

    Attributes:
        messages: How many.
        until: How long they tell of the run [s].
        lost: What could not be saved, by its place.
        nameless: Messages that could not be saved because no one says any more what they are.
    """

    messages: int
    until: float
    lost: tuple[Lost, ...] = ()
    nameless: int = 0


def recover(path: Path, output: Path, *, overwrite: bool = False) -> Saved | None:
    """Write all that is sound of an MCAP file that has no end, or is damaged, into a new one that is whole.

    The old file stays as it is, unless it is the output, too. The output is there when it is complete, not before.

    Args:
        path: What somebody wrote who was killed, or whose disk has changed it.
        output: Where to.
        overwrite: Whether there may be something already.

    Returns:
        None if the old file is whole: there is nothing to do, and nothing was written.

    Raises:
        RecordingError: It cannot be read, holds nothing that could be saved, or the output cannot be written.
    """
    if output.exists() and not overwrite:
        raise RecordingError(f"{output} is there already: give another name with --output, or add --overwrite")
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
    """What an MCAP file holds, without reading all of it.

    Raises:
        RecordingError: It is none.
    """
    with path.open("rb") as file:
        begin = file.read(len(MAGIC))
        if not begin:
            raise RecordingError("it is empty")
        if sum(one == other for one, other in zip(begin, MAGIC, strict=False)) < _ALIKE:
            raise RecordingError("it is no MCAP file")
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            yield content  # type: ignore[misc]  # it can be sliced like bytes


def _copy(content: bytes, writer: Writer) -> Saved:
    """Write all sound pieces, and an end."""
    channels = _define(content, writer)
    count, nameless, latest = 0, 0, -math.inf
    lost: list[Lost] = []
    for piece in pieces(content):
        if isinstance(piece, Loss):
            lost = _with(lost, piece, latest)
            continue
        messages = [record for record in piece.records if isinstance(record, Message)]
        if messages:
            first = min(message.log_time for message in messages) / 1e9
            lost = [replace(each, before=min(each.before, first)) for each in lost]
            latest = max(latest, max(message.log_time for message in messages) / 1e9)
        for message in messages:
            if message.channel_id in channels:
                writer.add_message(
                    channels[message.channel_id],
                    message.log_time,
                    message.data,
                    message.publish_time,
                    message.sequence,
                )
                count += 1
            else:
                nameless += 1
        _copy_others(piece, writer)
    if count == 0:
        raise RecordingError("there is no message in it that could be saved")
    writer.finish()
    return Saved(count, latest, tuple(lost), nameless)


def _define(content: bytes, writer: Writer) -> dict[int, int]:
    """Write what topics and types a file has; return the new number of each topic, by the old one.

    A chunk defines the topics of which it has the first message. If it is damaged, a copy of the definitions tells what
    those of later chunks are. What has a checksum counts more than what has none.
    """
    header = Header("", "")
    found: dict[tuple[type[McapRecord], int], McapRecord] = {}
    for piece in pieces(content):
        if isinstance(piece, Loss):
            continue
        for record in _with_copied(piece.records):
            match record:
                case Header():
                    header = record
                case Schema() | Channel() if piece.is_sealed or (type(record), record.id) not in found:
                    found[type(record), record.id] = record
                case _:
                    pass
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
    """All records, and those of which a file has a copy."""
    for record in records:
        yield record
        if isinstance(record, Attachment) and record.name == COPY:
            with suppress(*DAMAGE):
                yield from breakup_chunk(Chunk("", record.data, 0, 0, 0, len(record.data)))


def _with(lost: list[Lost], loss: Loss, latest: float) -> list[Lost]:
    if lost and lost[-1].end == loss.start:
        return [*lost[:-1], replace(lost[-1], end=loss.end)]
    return [*lost, Lost(loss.start, loss.end, latest, math.inf)]


def _copy_others(piece: Piece, writer: Writer) -> None:
    """Write what is no message; the new file needs no copy of its definitions."""
    for record in piece.records:
        match record:
            case Attachment() if record.name != COPY:
                writer.add_attachment(record.create_time, record.log_time, record.name, record.media_type, record.data)
            case Metadata():
                writer.add_metadata(record.name, record.metadata)
            case _:
                pass
