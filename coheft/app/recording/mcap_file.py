"""Writing of an MCAP file of ROS 2 messages."""

from collections.abc import Iterable, Mapping
from typing import BinaryIO

from mcap.data_stream import RecordBuilder
from mcap.records import Channel, McapRecord, Schema
from mcap.writer import CompressionType, Writer

import coheft
from coheft.app.recording.ros import RosMessage, definition, to_cdr

COPY = "definitions.mcap"
"""Name of attachments with all records that define topics and types: messages cannot be read without these, and the
chunk that contains them may be damaged."""
_CHUNK = 2**18
"""Messages are compressed together in chunks of about this size [bytes]."""


def make_writer(file: BinaryIO) -> Writer:
    """Return the library's writer with our settings; nothing is written yet."""
    return Writer(file, chunk_size=_CHUNK, compression=CompressionType.ZSTD, enable_data_crcs=True)


class McapFile:
    """Writes messages; topics are defined when they are first used."""

    def __init__(self, file: BinaryIO) -> None:
        self._writer = make_writer(file)
        self._writer.start(profile="ros2", library=f"coheft {coheft.__version__}")
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._definitions: list[McapRecord] = []
        self._copied = 0
        self._repeated: list[tuple[str, str, bytes]] = []
        self._flushes = 0

    def describe(self, name: str, values: Mapping[str, str]) -> None:
        """Add a table of metadata."""
        self._writer.add_metadata(name, dict(values))

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Add an attachment."""
        self._writer.add_attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=data)

    def repeat(self, name: str, media_type: str, data: bytes) -> None:
        """Add an attachment that is essential for reading the file: now, and again at some of the next flushes."""
        self._repeated.append((name, media_type, data))
        self.attach(name, media_type, data)

    def write(self, topic: str, time: int, message: RosMessage) -> None:
        """Add a message at a simulated time [ns]; all messages of a topic must have the same type."""
        if topic not in self._channels:
            self._channels[topic] = self._new_channel(topic, message.__msgtype__)
        self._writer.add_message(self._channels[topic], log_time=time, data=to_cdr(message), publish_time=time)

    def _new_channel(self, topic: str, kind: str) -> int:
        if kind not in self._schemas:
            schema = self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", definition(kind))
            self._definitions.append(Schema(schema, definition(kind), "ros2msg", kind))
        channel: int = self._writer.register_channel(topic, "cdr", self._schemas[kind])
        self._definitions.append(Channel(channel, topic, "cdr", {}, self._schemas[kind]))
        return channel

    def flush(self) -> None:
        """Pass everything to the operating system: if the process is killed afterwards, none of it is lost."""
        self._writer.flush()
        self._flushes += 1
        is_time_to_repeat = self._flushes & (self._flushes - 1) == 0  # 1, 2, 4, 8, …
        if self._copied < len(self._definitions) or (is_time_to_repeat and self._copied):
            self._copied = len(self._definitions)
            self.attach(COPY, "application/octet-stream", _bytes(self._definitions))
        if is_time_to_repeat:
            for each in self._repeated:
                self.attach(*each)
        self._writer.flush()

    def finish(self) -> None:
        """Write the summary; nothing can be added afterwards."""
        self._writer.finish()


def _bytes(records: Iterable[McapRecord]) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())
