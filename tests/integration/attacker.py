"""Somebody who does not play by the rules: a raw Zenoh session that says, asks and listens for all it can."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import zenoh

from coheft.wire.transport.security import Credentials, credentials_in

ROUNDS = 25
ROUND = 0.01
"""Seconds between two rounds of what both sides say; in the open profile the first rounds are heard already."""
PUSHING: dict[str, object] = {"gateway": {"south": [{}]}}
"""Makes a client take everyone for its subordinate: the only kind of client that our sessions let in."""


@dataclass(frozen=True)
class Profile:
    """The open profile, or the secure one with everyone's keys in a folder."""

    keys: Path | None

    def credentials(self, name: str) -> Credentials | None:
        return credentials_in(self.keys, name) if self.keys is not None else None

    def endpoint(self, port: int) -> str:
        return f"{'tls' if self.keys is not None else 'tcp'}/127.0.0.1:{port}"


@contextmanager
def raw_session(
    connect: Sequence[str] = (),
    listen: Sequence[str] = (),
    tls: dict[str, object] | None = None,
    mode: str = "peer",
    **settings: object,
) -> Iterator[zenoh.Session]:
    """A session with Zenoh's own settings; opening it fails if no one lets it in within two seconds.

    Raises:
        zenoh.ZError: No one let it in.
    """
    config = {
        "mode": mode,
        "scouting": {"multicast": {"enabled": False}},
        "listen": {"endpoints": list(listen)},
        "connect": {"endpoints": list(connect), "timeout_ms": 2000, "exit_on_failure": True},
        "transport": {"link": {"tls": tls or {}}},
        **settings,
    }
    with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session:
        yield session


def tls_settings(credentials: Credentials | None) -> dict[str, object]:
    """What a raw session needs to be the one to whom the credentials belong."""
    if credentials is None:
        return {}
    return {
        "root_ca_certificate": credentials.authority,
        "enable_mtls": True,
        **{f"{side}_certificate": credentials.certificate for side in ("listen", "connect")},
        **{f"{side}_private_key": credentials.key for side in ("listen", "connect")},
    }


@dataclass
class Crossing:
    """What came through a session from the others: keys by the way in which they came."""

    heard: set[str] = field(default_factory=set)
    deleted: set[str] = field(default_factory=set)
    asked: set[str] = field(default_factory=set)
    answered: set[str] = field(default_factory=set)
    alive: set[str] = field(default_factory=set)
    shown: set[str] = field(default_factory=set)

    @property
    def is_empty(self) -> bool:
        return not (self.heard or self.deleted or self.asked or self.answered or self.alive or self.shown)


class Busybody:
    """All ears on a session, and a mouth for whatever keys it is told to speak under.

    Args:
        session: Any session.
        says: Keys to say something under.
        asks: Keys to ask under.
        listens: What to listen to.
        answers: Keys under which it answers, and is alive.
        shows: More keys under which it is alive.
        watches: Under which keys to watch who is alive.
    """

    def __init__(
        self,
        session: zenoh.Session,
        says: Sequence[str],
        asks: Sequence[str] = (),
        listens: Sequence[str] = ("**",),
        answers: Sequence[str] = (),
        shows: Sequence[str] = (),
        watches: Sequence[str] = ("**",),
    ) -> None:
        self.came = Crossing()
        self._session, self._says, self._asks = session, says, asks
        self._tokens = (*answers, *shows)
        remote = zenoh.Locality.REMOTE
        self._kept: list[object] = [
            session.declare_subscriber(key, self._receive, allowed_origin=remote) for key in listens
        ]
        self._kept += [session.declare_publisher(key) for key in says]
        for key in answers:
            self._kept.append(session.declare_queryable(key, self._answer, allowed_origin=remote))

        self._kept += [session.liveliness().declare_token(key) for key in self._tokens]
        self._kept += [session.liveliness().declare_subscriber(key, self._see, history=True) for key in watches]

    def _see(self, sample: zenoh.Sample) -> None:
        if str(sample.key_expr) not in self._tokens:
            self.came.shown.add(str(sample.key_expr))

    def _receive(self, sample: zenoh.Sample) -> None:
        where = self.came.heard if sample.kind == zenoh.SampleKind.PUT else self.came.deleted
        where.add(str(sample.key_expr))

    def _answer(self, query: zenoh.Query) -> None:
        with query:
            self.came.asked.add(str(query.key_expr))
            query.reply(query.key_expr, b"")

    def act(self) -> None:
        """One round."""
        for key in self._says:
            self._session.put(key, b"", congestion_control=zenoh.CongestionControl.BLOCK, express=True)
            self._session.delete(key, express=True)
        for key in self._asks:
            for reply in self._session.get(key, target=zenoh.QueryTarget.ALL, timeout=0.2):
                if reply.ok is not None:
                    self.came.answered.add(str(reply.ok.key_expr))

    def look_around(self) -> None:
        """Ask who else is alive."""
        for reply in self._session.liveliness().get("**", timeout=0.5):
            if reply.ok is not None and str(reply.ok.key_expr) not in self._tokens:
                self.came.alive.add(str(reply.ok.key_expr))


def let_act(*busybodies: Busybody) -> None:
    """Let all of them act for a while, then look around."""
    for _ in range(ROUNDS):
        for busybody in busybodies:
            busybody.act()
        time.sleep(ROUND)
    for busybody in busybodies:
        busybody.look_around()
