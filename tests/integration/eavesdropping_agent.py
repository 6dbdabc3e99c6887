"""An agent that also listens to whatever comes, on all of its links, and asks everyone who is there.

The agent itself is the real one. What it hears is written to ``$HEARD_FOLDER/<name>.json`` when the run is over.
"""

from __future__ import annotations

import itertools
import json
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import zenoh

from coheft.agents.agent import Agent, Outbox
from coheft.agents.process import links
from coheft.agents.process import main as process
from coheft.wire.config import AgentProcessConfig
from coheft.wire.messages.codec import encode
from coheft.wire.messages.requests import StatusRequest
from coheft.wire.messages.size import LEAST_LIMIT
from coheft.wire.process.supervised import supervised_main
from coheft.wire.transport import dialled
from coheft.wire.transport.security import Guard
from coheft.wire.transport.sessions import Keys, open_session

ASK_EVERY = 20
"""Blocks between two rounds of questions."""


class Spy:
    """Ears and mouth on one session."""

    def __init__(self, session: zenoh.Session, plane: str, name: str, run: str) -> None:
        self._session = session
        self._request = Keys(run).request("operator")
        self.heard: set[str] = set()
        self.answered: set[str] = set()
        self.alive: set[str] = set()
        own = f"leak/{plane}/{name}"
        remote = zenoh.Locality.REMOTE
        self._kept = [
            session.declare_subscriber(
                "**", lambda sample: self.heard.add(str(sample.key_expr)), allowed_origin=remote
            ),
            session.declare_queryable(own, lambda query: _answer(query, own), allowed_origin=remote),
            session.liveliness().declare_token(own),
        ]

    def ask_around(self) -> None:
        for key in ("leak/**", self._request):
            for reply in self._session.get(key, target=zenoh.QueryTarget.ALL, payload=encode(StatusRequest(), key)):
                if reply.ok is not None:
                    self.answered.add(str(reply.ok.key_expr))
        for reply in self._session.liveliness().get("leak/**"):
            if reply.ok is not None:
                self.alive.add(str(reply.ok.key_expr))


def _answer(query: zenoh.Query, own: str) -> None:
    with query:
        query.reply(own, b"")


def run(config: AgentProcessConfig) -> None:
    spies: dict[str, list[Spy]] = {"robot": [], "neighbour": [], "observer": []}

    @contextmanager
    def open_with_spy(
        listen: Iterable[str] = (),
        connect: Iterable[str] = (),
        guard: Guard | None = None,
        largest: int = LEAST_LIMIT,
    ) -> Iterator[zenoh.Session]:
        listen, connect = list(listen), list(connect)
        plane = "robot" if config.server in connect else "observer" if config.observe in listen else "neighbour"
        with open_session(listen, connect, guard, largest) as session:
            spies[plane].append(Spy(session, plane, config.agent.name, config.run))
            yield session

    class AskingAgent(Agent):
        """All others are alive while it asks: none can go on without its message."""

        def step(self, *arguments) -> Outbox:  # type: ignore[no-untyped-def]
            outbox = super().step(*arguments)
            if outbox.message.block % ASK_EVERY == ASK_EVERY - 1:
                for spy in itertools.chain(*spies.values()):
                    spy.ask_around()
            return outbox

    links.open_session = dialled.open_session = open_with_spy  # type: ignore[attr-defined]
    process.Agent = AskingAgent  # type: ignore[attr-defined,misc]
    process.run_agent(config)
    report = {
        plane: {
            sense: sorted(set().union(*(getattr(spy, sense) for spy in of_plane)))
            for sense in ("heard", "answered", "alive")
        }
        for plane, of_plane in spies.items()
    }
    (Path(os.environ["HEARD_FOLDER"]) / f"{config.agent.name}.json").write_text(json.dumps(report))


if __name__ == "__main__":
    supervised_main(AgentProcessConfig, run)
