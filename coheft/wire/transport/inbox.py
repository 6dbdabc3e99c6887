"""All that a process hears, decoded and checked; no source can crowd out the others, or fill the memory."""

from __future__ import annotations

from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from typing import Any, cast

import msgspec
import zenoh

from coheft.errors import MessageError
from coheft.wire.messages.codec import Reader, decode, encode
from coheft.wire.messages.requests import Refusal, Request
from coheft.wire.messages.structs import Message
from coheft.wire.transport.backlog import Backlog, Lost, Said
from coheft.wire.transport.security import Guard
from coheft.wire.transport.sessions import REFUSAL, Role, session_id


class Received(msgspec.Struct, frozen=True):
    """A message, from the source whose key it came under."""

    source: str
    message: Message


@dataclass(frozen=True)
class Refused:
    """What came from a source is not what its key promises, or more than there is room for, or it may not come here."""

    source: str
    error: MessageError


@dataclass(frozen=True)
class LinkChange:
    """A process has come to, or gone from, the session called ``source``, which now has so many ``links``.

    Attributes:
        source: What the session is called.
        links: How many processes are there.
        session: Identity of the session: another one may have taken its place since.
    """

    source: str
    links: int
    session: str = field(default="", compare=False)


@dataclass(frozen=True)
class Presence:
    """A source has come within one hop, or has gone: one of its links stands, or none.

    Attributes:
        source: Who.
        is_here: Whether it has come.
        session: Identity of the session that saw it: another one may have taken its place since.
    """

    source: str
    is_here: bool
    session: str = field(default="", compare=False)


@dataclass(frozen=True)
class Question:
    """A request that waits for its answer, and the role in which it was asked."""

    role: Role
    request: Message
    _query: zenoh.Query

    def answer(self, message: Message) -> None:
        """Answer it, once."""
        _answer(self._query, message)


Event = Received | Refused | LinkChange | Presence | Question


class Inbox:
    """All that a process hears, on all of its sessions: one thread, the caller's, handles it.

    Zenoh's own threads do no more than to put things into a queue, which costs a few microseconds per message; decoding
    is done by the caller of ``receive``. What one source says stays in order.
    """

    def __init__(self) -> None:
        self._turns: SimpleQueue[Backlog] = SimpleQueue()
        self._backlogs: dict[str, Backlog] = {}
        self._readers: dict[str, tuple[str, Reader[Message]]] = {}
        self._roles: dict[str, tuple[Role, Any]] = {}
        self._kept: dict[str, list[Any]] = {}  # by session; a subscriber that no one holds goes silent

    def listen(self, session: zenoh.Session, source: str, kinds: dict[str, type[Message]]) -> None:
        """Hear one source.

        Args:
            session: Where.
            source: Name under which events are reported.
            kinds: What is expected under which key; keys differ in their last part only. One subscription serves them
                all: when a message under one key has come through, those under the others will.

        Raises:
            ValueError: The keys differ in more than their last part.
        """
        places = {key.rpartition("/")[0] for key in kinds}
        if len(places) != 1:
            raise ValueError(f"keys are below {sorted(places)} but expected one place")
        self._readers |= {key: (source, Reader(kind, key)) for key, kind in kinds.items()}
        self._keep(
            session,
            session.declare_subscriber(
                f"{places.pop()}/*", self._handler(source), allowed_origin=zenoh.Locality.REMOTE
            ),
        )

    def watch_links(self, session: zenoh.Session, source: str, guard: Guard | None = None) -> None:
        """Hear of processes that come and go at a session; with its guard, only of those that may come."""
        linked: set[str] = set()  # the session's own list may lag behind its events
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
            backlog.put(LinkChange(source, len(linked), own))

        self._keep(session, session.info.declare_link_events_listener(put, history=True))

    def announce(self, session: zenoh.Session, key: str) -> None:
        """Be there for all who watch the presence under a key, as long as a link with them stands."""
        self._keep(session, session.liveliness().declare_token(key))

    def watch_presence(self, session: zenoh.Session, source: str, key: str) -> None:
        """Hear whether a source that announces itself under a key is there.

        On a session with several links this tells whose link it is; one that is cut takes its token along at once, one
        that is frozen when its lease ends.
        """
        backlog, own = Backlog(source, self._turns), session_id(session)

        def put(sample: zenoh.Sample) -> None:
            backlog.put(Presence(source, sample.kind == zenoh.SampleKind.PUT, own))

        handler = zenoh.handlers.Callback(put, indirect=False)
        self._keep(session, session.liveliness().declare_subscriber(key, handler, history=True))

    def watch_strangers(self, session: zenoh.Session, guard: Guard | None) -> None:
        """Hear of participants who dial a session though nothing of it is for them."""
        backlog = self._backlog("strangers")
        if guard is None:
            return

        def put(event: zenoh.LinkEvent) -> None:
            name = event.link.auth_identifier
            if name not in guard.names and event.kind == zenoh.SampleKind.PUT:
                text = f"it dialled where only {', '.join(sorted(guard.names))} may"
                backlog.put(Refused(str(name), MessageError(text)))

        self._keep(session, session.info.declare_link_events_listener(put, history=True))

    def serve(self, session: zenoh.Session, roles: dict[str, Role], kind: Any = Request) -> None:
        """Hear questions.

        Args:
            session: Where.
            roles: In which role they are asked, by key.
            kind: What is asked: a message, or a union of tagged ones.
        """
        for key, role in roles.items():
            self._roles[key] = role, kind
            self._keep(session, session.declare_queryable(key, self._handler(role), complete=True))

    def forget(self, session: zenoh.Session) -> None:
        """Hear nothing more on a session; what it has said already stays."""
        for declared in self._kept.pop(session_id(session), []):
            declared.undeclare()

    def _keep(self, session: zenoh.Session, declared: object) -> None:
        self._kept.setdefault(session_id(session), []).append(declared)

    def _handler(self, source: str) -> Any:
        return zenoh.handlers.Callback(self._backlog(source).put, indirect=False)

    def _backlog(self, source: str) -> Backlog:
        return self._backlogs.setdefault(source, Backlog(source, self._turns))

    def backlog(self, source: str) -> int:
        """Memory taken by what a source has said and no one has read yet [B]."""
        return self._backlogs[source].size

    def receive(self, timeout: float | None = None) -> Event | None:
        """The next event, or None if there is none within ``timeout`` [s] (None: wait without limit)."""
        try:
            backlog = self._turns.get(timeout=timeout) if timeout != 0.0 else self._turns.get_nowait()
        except Empty:
            return None
        item = backlog.take()
        if isinstance(item, Said):
            return self._decode(item)
        if isinstance(item, zenoh.Query):
            return self._decode_query(item, backlog.source)
        if isinstance(item, Lost):
            return Refused(
                backlog.source, MessageError(f"{item.count} messages are lost: it says more than can be read")
            )
        return cast(LinkChange | Presence | Refused, item)

    def _decode(self, said: Said) -> Event:
        key = str(said.key)
        source, reader = self._readers.get(key, (key, None))
        if reader is None:
            return Refused(source, MessageError(f"nothing is expected under the key '{key}'"))
        try:
            return Received(source, reader.read(said.data))
        except MessageError as error:
            return Refused(source, error)

    def _decode_query(self, query: zenoh.Query, source: str) -> Event:
        payload = query.payload.to_bytes() if query.payload is not None else b""
        key = str(query.key_expr)
        try:
            if key not in self._roles:
                raise MessageError(f"nothing is answered under the key '{key}'")
            role, kind = self._roles[key]
            return Question(role, decode(payload, kind, key), query)
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
