"""The messages of the observer plane as bytes under separate topics, so that a replay is exact."""

from coheft.wire.messages.codec import decode, encode
from coheft.wire.messages.former_frame import decode_former, is_former
from coheft.wire.messages.requests import Status
from coheft.wire.messages.structs import Estimate, EstimateBeside, Message, Problem
from coheft.wire.messages.truth import Truth

STATUS = "/coheft/status"
KINDS: dict[str, type[Message]] = {
    STATUS: Status,
    "/coheft/truth": Truth,
    "/coheft/estimate": Estimate,
    "/coheft/estimate_beside": EstimateBeside,
    "/coheft/problem": Problem,
}
"""Types of messages by topic."""
_TOPICS = {kind: topic for topic, kind in KINDS.items()}


def to_raw(message: Message) -> tuple[str, bytes]:
    """Return the topic and the bytes of a message."""
    topic = _TOPICS[type(message)]
    return topic, encode(message, topic)


def from_raw(topic: str, data: bytes) -> Message:
    """Decode a recorded message; ``MessageError`` if it is damaged, or of a protocol that is too old or too new."""
    if is_former(data):
        return decode_former(data, KINDS[topic], topic)
    return decode(data, KINDS[topic], topic)
