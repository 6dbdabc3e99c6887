"""Zenoh sessions between processes: explicit links, no discovery, nothing that is handed on to a third party.

A process opens at least one session per plane (see ``coheft.wire.messages.structs``), so that nothing crosses from one
plane to another. What it says goes out through a ``Sender``; what it hears comes through one ``Inbox``.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from threading import Lock, Thread
from typing import Any, Literal, TypeVar, get_args

# Few threads for all of Zenoh's work: fewer switches between threads per message. Not one, because each listener that
# freezes takes a thread until its link is cut, and with none left all other links fall silent and are cut too.
# Read when the first session opens.
os.environ.setdefault(
    "ZENOH_RUNTIME", "(rx:(worker_threads:4),tx:(handover:rx),acc:(handover:rx),app:(handover:rx),net:(handover:rx))"
)

import zenoh

from coheft.errors import CoheftError, LinkError
from coheft.wire.messages.codec import Writer, decode, encode
from coheft.wire.messages.requests import Refusal, Request, Status
from coheft.wire.messages.size import LEAST_LIMIT
from coheft.wire.messages.structs import Message
from coheft.wire.transport.security import Guard

Role = Literal["observer", "operator"]
"""As what somebody asks the server: an observer may only ask how the run is."""
ROLES: tuple[Role, ...] = get_args(Role)

M = TypeVar("M", bound=Message)

REFUSAL = zenoh.Encoding("coheft/refusal")
"""Marks what is refused by one of us: Zenoh itself answers questions that have waited too long for an answer."""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")

_SETTINGS: dict[str, object] = {
    "mode": "peer",
    # Together these three keep every message to one hop: peers neither look for others nor tell each other of others,
    # and no peer serves as a gateway to those who dial it, not even to clients.
    "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
    "gateway": {"south": []},
    # Opening takes half a second otherwise while somebody does not answer yet: all that use links wait for them anyway.
    "open": {"return_conditions": {"connect_scouted": False}},
}
_LINK_SETTINGS: dict[str, object] = {
    "tx": {
        "lease": 1000,  # [ms]: a frozen process is noticed after this
        # [us]: enough for a listener that is short of time, too little for a frozen one to hold up the run.
        "queue": {
            "congestion_control": {
                "drop": {"wait_before_drop": 50_000},
                # [us]: a link that has been too slow for so long that megabytes wait for it is cut and dialled anew.
                # Well below the lease: a link that is back while a message still waits for the old one stays mute.
                "block": {"wait_before_close": 200_000},
            }
        },
    },
}
_DIAL_SETTINGS: dict[str, object] = {
    # Dial without end, in the background: processes start in any order.
    "timeout_ms": -1,
    "exit_on_failure": False,
    "retry": {"period_init_ms": 20, "period_max_ms": 50, "period_increase_factor": 1.5},
}
_FAREWELL = 1.0
"""Time to close a session [s]: whoever is frozen at the other end takes no farewell, for which Zenoh waits 10 s."""


@contextmanager
def open_session(
    listen: Iterable[str] = (),
    connect: Iterable[str] = (),
    guard: Guard | None = None,
    largest: int = LEAST_LIMIT,
) -> Iterator[zenoh.Session]:
    """A session whose only links are those that are given; closed at the end of the context.

    Args:
        listen: Endpoints where others may dial in, such as ``tcp/127.0.0.1:20000``, or ``tls/127.0.0.1:20000`` if there
            is a guard.
        connect: Endpoints to dial, until somebody answers.
        guard: Who may be at the other ends, and say what; None: whoever comes, and everything.
        largest: Messages that are larger are dropped before they are put together [B].

    Raises:
        LinkError: An endpoint is malformed, or somebody listens there already.
    """
    listen, connect = list(listen), list(connect)
    settings = {
        **_SETTINGS,
        "listen": {"endpoints": listen, "exit_on_failure": True},
        "connect": {"endpoints": connect, **_DIAL_SETTINGS},
        "transport": {
            "link": _LINK_SETTINGS
            | {"rx": {"max_message_size": largest}}
            | (guard.link_settings if guard is not None else {}),
            "shared_memory": {"enabled": False},  # no faster for small messages
        },
    }
    if guard is not None:
        settings["access_control"] = guard.access_settings
    try:
        session = zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))
    except zenoh.ZError as error:
        raise LinkError(f"cannot listen at {listen} and dial {connect}: {error}") from error
    try:
        yield session
    finally:
        closing = Thread(target=_close, args=(session,), daemon=True)
        closing.start()
        closing.join(_FAREWELL)


def _close(session: zenoh.Session) -> None:
    with suppress(zenoh.ZError):  # Zenoh has given up
        session.close()  # type: ignore[no-untyped-call]


def session_id(session: zenoh.Session) -> str:
    """Its identity; no two sessions have the same."""
    return str(session.zid())


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
        """Neighbour plane: ``hello``, ``block``; under ``alive`` nothing is said, see ``Inbox.watch_presence``."""
        return f"{self.run}/agent/{check_name(name)}/{topic}"

    def observe_agent(self, name: str, topic: str) -> str:
        """Observer plane of an agent: ``estimate``, ``problem``."""
        return f"{self.run}/observe/agent/{check_name(name)}/{topic}"

    def observe_server(self, topic: str) -> str:
        """Observer plane of the server: ``truth``, ``problem``, ``end``."""
        return f"{self.run}/observe/server/{topic}"

    def request(self, role: Role) -> str:
        """Where the server answers those who ask in a role."""
        return f"{self.run}/server/request/{role}"

    def request_agent(self, name: str) -> str:
        """Where an agent answers the operator."""
        return f"{self.run}/request/agent/{check_name(name)}"


class Sender:
    """Says messages of one kind under one key, from any thread.

    Args:
        session: The plane's session; None: those that are attached later.
        key: What to say it under.
        may_drop: When a listener does not keep up, lose messages rather than wait for it. Right for observers: one
            that is frozen must not hold up the run.
    """

    def __init__(self, session: zenoh.Session | None, key: str, *, may_drop: bool) -> None:
        self._control = zenoh.CongestionControl.DROP if may_drop else zenoh.CongestionControl.BLOCK
        self._key, self._writer = key, Writer(key)
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._lock = Lock()
        if session is not None:
            self.attach(session)

    def attach(self, session: zenoh.Session) -> None:
        """Say it on one more session, too."""
        publisher = session.declare_publisher(self._key, congestion_control=self._control, express=True)
        with self._lock:
            self._publishers[session_id(session)] = publisher

    def detach(self, session: zenoh.Session) -> None:
        """Say nothing more on a session."""
        with self._lock:
            publisher = self._publishers.pop(session_id(session))
        publisher.undeclare()  # type: ignore[no-untyped-call]

    def send(self, message: Message) -> None:
        """Say it to all who listen now."""
        data = self._writer.write(message)
        with self._lock:
            for publisher in self._publishers.values():
                publisher.put(data)

    @property
    def has_listener(self) -> bool:
        """Whether anybody listens now."""
        statuses: list[Any] = [publisher.matching_status for publisher in self._publishers.values()]
        return any(status.matching for status in statuses)  # objects, though the type stub says bool


def ask(session: zenoh.Session, key: str, request: Request, timeout: float = 2.0) -> Status | Refusal:
    """Ask the server, see ``ask_for``."""
    return ask_for(Status, session, key, request, timeout)


def ask_for(kind: type[M], session: zenoh.Session, key: str, request: Message, timeout: float = 2.0) -> M | Refusal:
    """Ask whoever answers under a key.

    Args:
        kind: Of the answer.
        session: Where to ask.
        key: Under which the request is answered.
        request: What is asked.
        timeout: How long to wait [s].

    Raises:
        LinkError: There is no answer within ``timeout`` [s].
        MessageError: The answer makes no sense.
    """
    for reply in session.get(key, payload=encode(request, key), timeout=timeout):
        if reply.ok is not None:
            return decode(reply.ok.payload.to_bytes(), kind, key)
        if reply.err is not None and reply.err.encoding == REFUSAL:  # else these are Zenoh's own words, of a timeout
            return decode(reply.err.payload.to_bytes(), Refusal, key)
    raise LinkError(f"no answer to the request under '{key}' within {timeout:g} s")
