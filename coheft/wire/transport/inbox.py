"""All messages that a process receives, decoded and checked; no source can delay the others, or fill the memory."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from types import UnionType
from typing import Any, cast

import msgspec
import zenoh

from coheft.errors import MessageError
from coheft.wire.messages.codec import decode, encode
from coheft.wire.messages.requests import Refusal, Request
from coheft.wire.messages.structs import Message
from coheft.wire.transport.backlog import Backlog, RawMessage
from coheft.wire.transport.security import Guard
from coheft.wire.transport.sessions import REFUSAL, Role, session_id


class Received(msgspec.Struct, frozen=True):
    """A message, with the source to which its key belongs."""

    source: str
    message: Message


@dataclass(frozen=True)
class Refused:
    """A refused message: invalid, too many for the queue, or not allowed here."""

    source: str
    error: MessageError


@dataclass(frozen=True)
class Presence:
    """A source has become reachable within one hop, or unreachable.

    Attributes:
        session: Identity of the session that noticed it, which may have been replaced since.
    """

    source: str
    is_here: bool
    session: str = field(default="", compare=False)


@dataclass(frozen=True)
class Question:
    """A request that waits for an answer, and the role of the sender."""

    role: Role
    request: Message
    _query: zenoh.Query

    def answer(self, message: Message) -> None:
        """Answer the request; to be called once."""
        _answer(self._query, message)


Event = Received | Refused | Presence | Question


class Inbox:
    """All messages that a process receives on all of its sessions, handled by one thread, the caller's.

    Zenoh's threads only put items into a queue, which takes some microseconds per message; the caller of ``receive``
    decodes them. Messages of one source stay in order.
    """

    def __init__(self) -> None:
        self._turns: SimpleQueue[Backlog] = SimpleQueue()
        self._backlogs: dict[str, Backlog] = {}
        self._kinds: dict[str, tuple[str, Any]] = {}  # of messages and requests by key, with the source or role
        self._kept: dict[str, list[Any]] = {}  # by session; a subscriber without a reference is closed

    def listen(self, session: zenoh.Session, source: str, kinds: Mapping[str, type[Message] | UnionType]) -> None:
        """Receive the messages of one source, which events name so.

        ``kinds`` has the expected type of message by key, or a union of types; the keys differ in their last part only.
        They share one subscription, so that if messages under one key arrive, those under the others do, too.
        """
        self._kinds |= {key: (source, kind) for key, kind in kinds.items()}
        place = f"{next(iter(kinds)).rpartition('/')[0]}/*"
        handler = self._handler(source)
        self._keep(session, session.declare_subscriber(place, handler, allowed_origin=zenoh.Locality.REMOTE))

    def watch_links(self, session: zenoh.Session, source: str, guard: Guard | None = None) -> None:
        """Receive whether any process is linked with a session; with a guard, only of processes that are allowed."""
        linked: set[str] = set()  # the session's own list may be older than the event
        own = session_id(session)
        backlog = self._backlog(source)

        def put(event: zenoh.LinkEvent) -> None:
            if guard is not None and event.link.auth_identifier not in guard.names:
                return
            peer = str(event.link.zid)
            if event.kind == zenoh.SampleKind.PUT:
                linked.add(peer)
            else:
                linked.discard(peer)
            backlog.put(Presence(source, bool(linked), own))

        self._keep(session, session.info.declare_link_events_listener(put, history=True))

    def announce(self, session: zenoh.Session, key: str) -> None:
        """Announce this process to all that watch its presence under a key, while their link is up."""
        self._keep(session, session.liveliness().declare_token(key))

    def watch_presence(self, session: zenoh.Session, source: str, key: str) -> None:
        """Receive changes of the presence of a source that announces itself under a key.

        On a session with several links this tells which link is concerned. When a link is cut, it is noticed at once;
        when the other process is frozen, at the end of its lease.
        """
        backlog, own = Backlog(source, self._turns), session_id(session)

        def put(sample: zenoh.Sample) -> None:
            backlog.put(Presence(source, sample.kind == zenoh.SampleKind.PUT, own))

        handler = zenoh.handlers.Callback(put, indirect=False)
        self._keep(session, session.liveliness().declare_subscriber(key, handler, history=True))

    def watch_strangers(self, session: zenoh.Session, guard: Guard | None) -> None:
        """Report participants that dial a session at which they are not allowed."""
        if guard is None:
            return
        backlog = self._backlog("strangers")

        def put(event: zenoh.LinkEvent) -> None:
            name = event.link.auth_identifier
            if name not in guard.names and event.kind == zenoh.SampleKind.PUT:
                text = f"it dialled an endpoint that only {', '.join(sorted(guard.names))} may dial"
                backlog.put(Refused(str(name), MessageError(text)))

        self._keep(session, session.info.declare_link_events_listener(put, history=True))

    def serve(self, session: zenoh.Session, roles: dict[str, Role], kind: Any = Request) -> None:
        """Receive requests."""
        for key, role in roles.items():
            self._kinds[key] = role, kind
            self._keep(session, session.declare_queryable(key, self._handler(role), complete=True))

    def forget(self, session: zenoh.Session) -> None:
        """Stop receiving on a session; events that have arrived stay in the queue."""
        for declared in self._kept.pop(session_id(session), []):
            declared.undeclare()

    def _keep(self, session: zenoh.Session, declared: object) -> None:
        self._kept.setdefault(session_id(session), []).append(declared)

    def _handler(self, source: str) -> Any:
        return zenoh.handlers.Callback(self._backlog(source).put, indirect=False)

    def _backlog(self, source: str) -> Backlog:
        return self._backlogs.setdefault(source, Backlog(source, self._turns))

    def receive(self, timeout: float | None = None) -> Event | None:
        """Return the next event, or None if there is none within ``timeout`` [s] (None: wait without limit)."""
        try:
            backlog = self._turns.get(timeout=timeout) if timeout != 0.0 else self._turns.get_nowait()
        except Empty:
            return None
        item = backlog.take()
        if isinstance(item, RawMessage):
            return self._decode(item)
        if isinstance(item, zenoh.Query):
            return self._decode_query(item, backlog.source)
        if isinstance(item, int):
            why = f"{item} messages are lost: it sends faster than this process reads"
            return Refused(backlog.source, MessageError(why))
        return cast(Presence | Refused, item)

    def _decode(self, raw: RawMessage) -> Event:
        key = str(raw.key)
        source, kind = self._kinds.get(key, (key, None))
        if kind is None:
            return Refused(source, MessageError(f"no message is expected under the key '{key}'"))
        try:
            return Received(source, decode(raw.data, kind, key))
        except MessageError as error:
            return Refused(source, error)

    def _decode_query(self, query: zenoh.Query, source: str) -> Event:
        payload = query.payload.to_bytes() if query.payload is not None else b""
        key = str(query.key_expr)
        try:
            if key not in self._kinds:
                raise MessageError(f"no request is expected under the key '{key}'")
            role, kind = self._kinds[key]
            return Question(cast(Role, role), decode(payload, kind, key), query)
        except MessageError as error:
            _answer(query, Refusal(reason=str(error)))
            return Refused(f"the {source}", error)


def _answer(query: zenoh.Query, message: Message) -> None:
    data = encode(message, str(query.key_expr))
    with query:
        if isinstance(message, Refusal):
            query.reply_err(data, encoding=REFUSAL)
        else:
            query.reply(query.key_expr, data)
