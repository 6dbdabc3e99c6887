"""Zenoh sessions between processes: explicit links, no discovery, no forwarding to third parties.

A process opens at least one session per plane (see ``coheft.wire.messages.structs``), so that no message crosses from
one plane to another. It sends through a ``Sender`` and receives through one ``Inbox``.
"""

import json
import os
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from threading import Lock, Thread
from typing import Any, Literal, TypeVar, get_args

# Few threads for all of Zenoh's work, so that there are few thread switches per message. Not a single one, because each
# frozen listener occupies a thread until its link is cut; with none left all other links would fall silent.
# Zenoh reads the variable when the first session opens.
os.environ.setdefault(
    "ZENOH_RUNTIME", "(rx:(worker_threads:4),tx:(handover:rx),acc:(handover:rx),app:(handover:rx),net:(handover:rx))"
)

import zenoh

from coheft.errors import CoheftError, LinkError
from coheft.wire.messages.codec import decode, encode
from coheft.wire.messages.requests import Refusal
from coheft.wire.messages.size import LEAST_LIMIT
from coheft.wire.messages.structs import Message
from coheft.wire.process.leave import CLOSING
from coheft.wire.transport.security import Guard

Role = Literal["observer", "operator"]
"""The role of a client of the server: observers may only ask for the status."""
ROLES: tuple[Role, ...] = get_args(Role)

M = TypeVar("M", bound=Message)

REFUSAL = zenoh.Encoding("coheft/refusal")
"""Encoding of our own refusals; Zenoh itself also answers requests that have timed out."""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")

_SETTINGS: dict[str, object] = {
    "mode": "peer",
    # Together these three settings keep every message to one hop: peers neither look for others nor inform each other;
    # no peer serves as a gateway to those that dial it, not even to clients.
    "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
    "gateway": {"south": []},
    # Otherwise opening takes half a second while an endpoint does not answer; users of a link wait for it anyway.
    "open": {"return_conditions": {"connect_scouted": False}},
}
_LINK_SETTINGS: dict[str, object] = {
    "tx": {
        "lease": 1000,  # [ms]: time after which a frozen process is noticed
        # [us]: enough for a listener that is short of CPU time, too little for a frozen one to delay the run.
        "queue": {
            "congestion_control": {
                "drop": {"wait_before_drop": 50_000},
                # [us]: a link that is so slow that megabytes are waiting is cut and dialled again. Much less than the
                # lease: a link that is restored while a message waits for the old one does not work.
                "block": {"wait_before_close": 200_000},
            }
        },
    },
}
_DIAL_SETTINGS: dict[str, object] = {
    # Dial without limit, in the background: processes start in any order.
    "timeout_ms": -1,
    "exit_on_failure": False,
    "retry": {"period_init_ms": 20, "period_max_ms": 50, "period_increase_factor": 1.5},
}
_CLOSE_TIMEOUT = 1.0
"""Time to close a session [s]; Zenoh would wait 10 s for a frozen process at the other end."""


@contextmanager
def open_session(
    listen: Iterable[str] = (),
    connect: Iterable[str] = (),
    guard: Guard | None = None,
    largest: int = LEAST_LIMIT,
) -> Iterator[zenoh.Session]:
    """Open a session with the given links only; closed at the end of the context.

    Others may dial in at the endpoints ``listen``, such as ``tcp/127.0.0.1:20000``, or ``tls/127.0.0.1:20000`` with a
    guard; those of ``connect`` are dialled until they answer. Messages larger than ``largest`` [B] are dropped before
    they are assembled. An endpoint that is malformed, or at which another process listens, is a ``LinkError``.
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
        places = {"listen at": listen, "dial": connect}
        what = " and ".join(f"{verb} {', '.join(these)}" for verb, these in places.items() if these)
        reason = re.sub(r" at \S+\.rs:\d+\.?", "", str(error))  # places in Zenoh's source
        raise LinkError(f"cannot {what}: {reason}") from error
    try:
        yield session
    finally:
        closing = Thread(target=_close, args=(session,), name=CLOSING, daemon=True)
        closing.start()
        closing.join(_CLOSE_TIMEOUT)


def _close(session: zenoh.Session) -> None:
    with suppress(zenoh.ZError):  # raised if Zenoh gives up
        session.close()  # type: ignore[no-untyped-call]


def session_id(session: zenoh.Session) -> str:
    """Return the identity of a session, which is unique."""
    return str(session.zid())


def check_name(name: str) -> str:
    """Return a name if it can be part of a key; a ``CoheftError`` if its characters could change the key's meaning."""
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
        """Return a key of the robot plane: ``ready``, ``reference``; to the robot ``measurements``, ``stop``."""
        return f"{self.run}/robot/{check_name(name)}/{topic}"

    def agent(self, name: str, topic: str) -> str:
        """Return a key of the neighbour plane: ``hello``, ``block``, or ``alive`` for ``Inbox.watch_presence``."""
        return f"{self.run}/agent/{check_name(name)}/{topic}"

    def observe_agent(self, name: str, topic: str) -> str:
        """Return a key of an agent's observer plane: ``estimate``, ``problem``."""
        return f"{self.run}/observe/agent/{check_name(name)}/{topic}"

    def observe_server(self, topic: str) -> str:
        """Return a key of the server's observer plane: ``truth``, ``problem``, ``end``."""
        return f"{self.run}/observe/server/{topic}"

    def request(self, role: Role) -> str:
        """Return the key of requests to the server in a role."""
        return f"{self.run}/server/request/{role}"

    def request_agent(self, name: str) -> str:
        """Return the key of the operator's requests to an agent."""
        return f"{self.run}/request/agent/{check_name(name)}"


class Sender:
    """Sends messages of one kind under one key, from any thread.

    Args:
        session: The plane's session; None if sessions are attached later.
        may_drop: Whether to lose messages rather than wait when a listener does not keep up. True for observers,
            because a frozen one must not delay the run.
    """

    def __init__(self, session: zenoh.Session | None, key: str, *, may_drop: bool) -> None:
        self._control = zenoh.CongestionControl.DROP if may_drop else zenoh.CongestionControl.BLOCK
        self._key = key
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._lock = Lock()
        if session is not None:
            self.attach(session)

    def attach(self, session: zenoh.Session) -> None:
        """Send on one more session."""
        publisher = session.declare_publisher(self._key, congestion_control=self._control, express=True)
        with self._lock:
            self._publishers[session_id(session)] = publisher

    def detach(self, session: zenoh.Session) -> None:
        """Stop sending on a session."""
        with self._lock:
            publisher = self._publishers.pop(session_id(session))
        publisher.undeclare()  # type: ignore[no-untyped-call]

    def send(self, message: Message) -> None:
        """Send a message to all present listeners."""
        data = encode(message, self._key)
        with self._lock:
            for publisher in self._publishers.values():
                publisher.put(data)

    @property
    def has_listener(self) -> bool:
        """Whether there is a listener now."""
        statuses: list[Any] = [publisher.matching_status for publisher in self._publishers.values()]
        return any(status.matching for status in statuses)  # objects, though the type stub says bool


def ask(kind: type[M], session: zenoh.Session, key: str, request: Message, timeout: float = 2.0) -> M | Refusal:
    """Send a request under a key and return the answer, of type ``kind``; ``MessageError`` if that is invalid.

    No answer within ``timeout`` [s] is a ``LinkError``.
    """
    for reply in session.get(key, payload=encode(request, key), timeout=timeout):
        if reply.ok is not None:
            return decode(reply.ok.payload.to_bytes(), kind, key)
        if reply.err is not None and reply.err.encoding == REFUSAL:  # otherwise Zenoh reports a timeout
            return decode(reply.err.payload.to_bytes(), Refusal, key)
    raise LinkError(f"no answer to the request under '{key}' within {timeout:g} s")
