"""Zenoh sessions between processes: explicit links, no discovery, nothing that is handed on to a third party.

A process opens one session per plane (see ``coheft.wire.messages``), so that nothing crosses from one plane to another.
All that it hears comes through one ``Inbox``, already decoded and checked; what it says goes out through a ``Sender``.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any, cast

# Few threads for all of Zenoh's work: fewer switches between threads per message. Not one, because each listener that
# freezes takes a thread until its link is cut, and with none left all other links fall silent and are cut too.
# Read when the first session opens.
os.environ.setdefault(
    "ZENOH_RUNTIME", "(rx:(worker_threads:4),tx:(handover:rx),acc:(handover:rx),app:(handover:rx),net:(handover:rx))"
)

import zenoh

from coheft.errors import CoheftError, LinkError, MessageError
from coheft.wire.codec import decode, encode
from coheft.wire.messages import Message, Refusal, Request, Status

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")

_LINK_SETTINGS: dict[str, object] = {
    "mode": "peer",
    # Together these three keep every message to one hop: peers neither look for others nor tell each other of others,
    # and no peer serves as a gateway to those who dial it, not even to clients.
    "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
    "gateway": {"south": []},
    "transport": {
        "link": {
            "tx": {
                "lease": 1000,  # [ms]: a frozen process is noticed after this
                # [us]: enough for a listener that is short of time, too little for a frozen one to hold up the run.
                "queue": {"congestion_control": {"drop": {"wait_before_drop": 50_000}}},
            }
        },
        "shared_memory": {"enabled": False},  # no faster for small messages
    },
}
_DIAL_SETTINGS: dict[str, object] = {
    # Dial for ever, in the background: processes start in any order.
    "timeout_ms": -1,
    "exit_on_failure": False,
    "retry": {"period_init_ms": 20, "period_max_ms": 50, "period_increase_factor": 1.5},
}


@contextmanager
def open_session(listen: Iterable[str] = (), connect: Iterable[str] = ()) -> Iterator[zenoh.Session]:
    """A session whose only links are those that are given; closed at the end of the context.

    Args:
        listen: Endpoints where others may dial in, such as ``tcp/127.0.0.1:20000``.
        connect: Endpoints to dial, until somebody answers.

    Raises:
        LinkError: An endpoint is malformed, or somebody listens there already.
    """
    listen, connect = list(listen), list(connect)
    settings = {
        **_LINK_SETTINGS,
        "listen": {"endpoints": listen, "exit_on_failure": True},
        "connect": {"endpoints": connect, **_DIAL_SETTINGS},
    }
    try:
        session = zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))
    except zenoh.ZError as error:
        raise LinkError(f"cannot listen at {listen} and dial {connect}: {error}") from error
    with session:
        yield session


def check_name(name: str) -> str:
    """A name that can be part of a key.

    Raises:
        CoheftError: It has other characters than letters, digits, ``-`` and ``_``: they could change the key's meaning.
    """
    if not _NAME.fullmatch(name):
        raise CoheftError(f"{name!r} cannot be a name: expected letters, digits, '-' and '_', a letter or digit first")
    return name


@dataclass(frozen=True)
class Keys:
    """The keys of one run, all below its prefix."""

    run: str

    def __post_init__(self) -> None:
        check_name(self.run)

    def robot(self, name: str, topic: str) -> str:
        """Robot plane. Up: ``ready``, ``reference``; down: ``measurements``, ``stop``."""
        return f"{self.run}/robot/{check_name(name)}/{topic}"

    def agent(self, name: str, topic: str) -> str:
        """Neighbour plane: ``hello``, ``block``."""
        return f"{self.run}/agent/{check_name(name)}/{topic}"

    def observe_agent(self, name: str, topic: str) -> str:
        """Observer plane of an agent: ``estimate``, ``problem``."""
        return f"{self.run}/observe/agent/{check_name(name)}/{topic}"

    def observe_server(self, topic: str) -> str:
        """Observer plane of the server: ``truth``, ``problem``."""
        return f"{self.run}/observe/server/{topic}"

    @property
    def request(self) -> str:
        """Where the server answers."""
        return f"{self.run}/server/request"


class Sender:
    """Says messages of one kind under one key.

    Args:
        session: The plane's session.
        key: What to say it under.
        may_drop: When a listener does not keep up, lose messages rather than wait for it. Right for observers: one
            that is frozen must not hold up the run.
    """

    def __init__(self, session: zenoh.Session, key: str, *, may_drop: bool) -> None:
        control = zenoh.CongestionControl.DROP if may_drop else zenoh.CongestionControl.BLOCK
        self._key = key
        self._publisher = session.declare_publisher(key, congestion_control=control, express=True)

    def send(self, message: Message) -> None:
        """Say it to all who listen now."""
        self._publisher.put(encode(message, self._key))

    @property
    def has_listener(self) -> bool:
        """Whether anybody listens now."""
        status: Any = self._publisher.matching_status  # an object, though its type stub says bool
        return bool(status.matching)


@dataclass(frozen=True)
class Received:
    """A message, from the source whose key it came under."""

    source: str
    message: Message


@dataclass(frozen=True)
class Refused:
    """What came from a source is not what its key promises."""

    source: str
    error: MessageError


@dataclass(frozen=True)
class LinkChange:
    """A process has come to, or gone from, the session called ``source``, which now has so many ``links``."""

    source: str
    links: int


@dataclass(frozen=True)
class Question:
    """A request that waits for its answer."""

    request: Request
    _query: zenoh.Query

    def answer(self, message: Status | Refusal) -> None:
        """Answer it, once."""
        _answer(self._query, message)


Event = Received | Refused | LinkChange | Question


class Inbox:
    """All that a process hears, on all of its sessions, in one queue: one thread, the caller's, handles it.

    The queue's ``put`` is called by Zenoh's own thread with no Python code in between, which costs a few microseconds
    per message; decoding is done by the caller of ``receive``.
    """

    def __init__(self) -> None:
        self._queue: SimpleQueue[Any] = SimpleQueue()
        self._kinds: dict[str, tuple[str, type[Message]]] = {}
        self._kept: list[object] = []  # a subscriber that nobody holds goes silent

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
        self._kinds |= {key: (source, kind) for key, kind in kinds.items()}
        self._kept.append(
            session.declare_subscriber(f"{places.pop()}/*", self._handler(), allowed_origin=zenoh.Locality.REMOTE)
        )

    def watch_links(self, session: zenoh.Session, source: str) -> None:
        """Hear of processes that come and go at a session."""
        linked: set[str] = set()  # the session's own list may lag behind its events

        def put(event: zenoh.TransportEvent) -> None:
            peer = str(event.transport.zid)
            if event.kind == zenoh.SampleKind.PUT:
                linked.add(peer)
            else:
                linked.discard(peer)
            self._queue.put(LinkChange(source, len(linked)))

        self._kept.append(session.info.declare_transport_events_listener(put, history=True))

    def serve(self, session: zenoh.Session, key: str) -> None:
        """Hear questions that are asked under a key."""
        self._kept.append(session.declare_queryable(key, self._handler(), complete=True))

    def _handler(self) -> Any:
        return zenoh.handlers.Callback(self._queue.put, indirect=False)

    def receive(self, timeout: float | None = None) -> Event | None:
        """The next event, or None if there is none within ``timeout`` [s] (None: wait for ever)."""
        try:
            item = self._queue.get(timeout=timeout) if timeout != 0.0 else self._queue.get_nowait()
        except Empty:
            return None
        if isinstance(item, zenoh.Sample):
            return self._decode_sample(item)
        if isinstance(item, zenoh.Query):
            return self._decode_query(item)
        return cast(LinkChange, item)

    def _decode_sample(self, sample: zenoh.Sample) -> Event:
        key = str(sample.key_expr)
        source, kind = self._kinds.get(key, (key, None))
        if kind is None:
            return Refused(source, MessageError(f"nothing is expected under the key '{key}'"))
        try:
            return Received(source, decode(sample.payload.to_bytes(), kind, key))
        except MessageError as error:
            return Refused(source, error)

    def _decode_query(self, query: zenoh.Query) -> Event:
        payload = query.payload.to_bytes() if query.payload is not None else b""
        try:
            return Question(decode(payload, cast(type[Request], Request), str(query.key_expr)), query)
        except MessageError as error:
            _answer(query, Refusal(reason=str(error)))
            return Refused("an observer", error)


def _answer(query: zenoh.Query, message: Status | Refusal) -> None:
    data = encode(message, str(query.key_expr))
    with query:
        if isinstance(message, Refusal):
            query.reply_err(data)
        else:
            query.reply(query.key_expr, data)


def ask(session: zenoh.Session, key: str, request: Request, timeout: float = 2.0) -> Status | Refusal:
    """Ask the server.

    Raises:
        LinkError: There is no answer within ``timeout`` [s].
        MessageError: The answer makes no sense.
    """
    for reply in session.get(key, payload=encode(request, key), timeout=timeout):
        if reply.ok is not None:
            return decode(reply.ok.payload.to_bytes(), Status, key)
        if reply.err is not None and reply.err.payload:
            try:
                return decode(reply.err.payload.to_bytes(), Refusal, key)
            except MessageError:
                break  # Zenoh's own words for a timeout
    raise LinkError(f"no answer to the request under '{key}' within {timeout:g} s")
