"""Saves what there is of a recording that was not finished."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from mcap.records import Attachment, Channel, Header, McapRecord, Message, Metadata, Schema
from mcap.writer import Writer

from coheft.app.recording.mcap_file import make_writer
from coheft.app.recording.mcap_records import is_finished, read_records
from coheft.errors import RecordingError


@dataclass(frozen=True)
class Saved:
    """What could be saved: how many messages, and how long they tell of the run [s]."""

    messages: int
    until: float


def recover(path: Path, output: Path, *, overwrite: bool = False) -> Saved | None:
    """Write all that is sound of an unfinished MCAP file into a new one that has an end.

    The old file stays as it is, unless it is the output, too. The output is there when it is complete, not before.

    Args:
        path: What somebody wrote who was killed.
        output: Where to.
        overwrite: Whether there may be something already.

    Returns:
        None if the old file has an end: there is nothing to do, and nothing was written.

    Raises:
        RecordingError: It cannot be read, holds nothing that could be saved, or the output cannot be written.
    """
    if output.exists() and not overwrite:
        raise RecordingError(f"{output} is there already: give another name with --output, or add --overwrite")
    part = output.with_name(f"{output.name}.part")
    try:
        with path.open("rb") as old:
            if is_finished(old):
                return None
            with part.open("wb") as new:
                saved = _copy(read_records(old), make_writer(new))
        part.replace(output)
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error
    except OSError as error:
        raise RecordingError(f"{error.filename or part}: {error.strerror}") from error
    finally:
        part.unlink(missing_ok=True)
    return saved


def _copy(records: Iterable[McapRecord], writer: Writer) -> Saved:
    """Copy records up to the first that is cut or damaged, and write an end."""
    schemas = {0: 0}
    channels: dict[int, int] = {}
    count, until, has_begun = 0, 0, False
    try:
        for record in records:
            if not has_begun:  # a header whose own head is damaged is left out
                header = record if isinstance(record, Header) else Header("", "")
                writer.start(header.profile, header.library)
                has_begun = True
            match record:
                case Schema() if record.id not in schemas:
                    schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
                case Channel() if record.id not in channels:
                    schema = schemas[record.schema_id]
                    channels[record.id] = writer.register_channel(
                        record.topic, record.message_encoding, schema, record.metadata
                    )
                case Message():
                    writer.add_message(
                        channels[record.channel_id], record.log_time, record.data, record.publish_time, record.sequence
                    )
                    count, until = count + 1, max(until, record.log_time)
                case Attachment():
                    writer.add_attachment(
                        record.create_time, record.log_time, record.name, record.media_type, record.data
                    )
                case Metadata():
                    writer.add_metadata(record.name, record.metadata)
    except RecordingError as error:
        if count == 0:
            raise RecordingError(f"there is no message in it that could be saved: {error}") from error
    writer.finish()
    return Saved(count, until / 1e9)
