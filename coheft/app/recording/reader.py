"""Reading of recordings: returns exactly the messages that were received when they were made."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from mcap.records import Attachment, Channel, McapRecord
from mcap.records import Message as McapMessage

from coheft.app.recording.mcap_records import DamagedError, is_finished, read_records
from coheft.app.recording.raw import KINDS, STATUS, from_raw
from coheft.app.recording.ros import bytes_in
from coheft.app.run.news import News, check_news, check_status
from coheft.errors import MessageError, RecordingError, recording_errors
from coheft.wire.messages.requests import Status
from coheft.wire.messages.structs import Estimate, EstimateBeside, Message, Problem
from coheft.wire.transport.planes import SERVER

SCENARIO = "scenario.json"
"""Name of the attachment with the scenario."""
BEGIN = "begin.msgpack"
"""Name of the attachment with a copy of the first status, which is essential for showing a run."""


@dataclass(frozen=True, eq=False)
class Recording:
    """The messages of a recorded run.

    Attributes:
        begin: The server's status when the run had begun.
        scenario: The scenario as JSON of the struct ``Scenario``; empty if a damaged file has lost it.
        news: Simulated time [s] and message, in order of arrival.
    """

    begin: Status
    scenario: str
    news: list[tuple[float, News]]


def read_recording(path: Path) -> Recording:
    """Read a recording that ``coheft run --record`` made; ``RecordingError`` if it is incomplete or something else."""
    advice = f". To save its content: coheft recover {path}"
    with recording_errors(path), path.open("rb") as file:
        if not is_finished(file):
            raise RecordingError(f"it is incomplete: the process that writes it was killed, or still runs{advice}")
        try:
            return _collect(read_records(file))
        except DamagedError as error:
            raise RecordingError(f"{error}{advice}") from error
        except MessageError as error:
            raise RecordingError(str(error)) from error


def _collect(records: Iterable[McapRecord]) -> Recording:
    topics: dict[int, str] = {}
    attached: dict[str, bytes] = {}
    begin: Status | None = None
    news: list[tuple[float, News]] = []
    for record in records:
        match record:
            case Attachment():
                attached[record.name] = record.data
                if begin is None and record.name == BEGIN:
                    begin = _begin(from_raw(STATUS, record.data))
            case Channel():
                topics[record.id] = record.topic
            case McapMessage() if topics[record.channel_id] in KINDS:
                message = from_raw(topics[record.channel_id], bytes_in(record.data))
                if isinstance(message, Status):
                    begin = begin or _begin(message)
                elif begin is not None and (item := check_news(_source(message), message, begin.scene)) is not None:
                    news.append((record.log_time / 1e9, item))
    if begin is None:
        raise RecordingError("it contains no run, or one that never began; 'coheft run --record' makes recordings")
    try:
        scenario = attached.get(SCENARIO, b"").decode()
    except UnicodeDecodeError as error:
        raise RecordingError(f"its scenario is damaged: {error}") from error
    return Recording(begin, scenario, news)


def _begin(message: Message) -> Status:
    if not isinstance(message, Status):
        raise RecordingError("its first status is missing")
    check_status(message)
    return message


def _source(message: Message) -> str:
    match message:
        case Estimate() | EstimateBeside():
            return message.robot
        case Problem():
            return message.source
    return SERVER
