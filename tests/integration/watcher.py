"""Ears on the observer plane of a team: what every agent believes of itself, and when that was heard."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from coheft.wire.messages.structs import Estimate, Problem
from coheft.wire.transport.inbox import Inbox, Received
from coheft.wire.transport.planes import guard_observer
from coheft.wire.transport.security import credentials_in
from coheft.wire.transport.sessions import open_session
from tests.waiting import LIMIT

from .team import Team


@dataclass(frozen=True)
class Heard:
    """Something that an agent has said.

    Attributes:
        at: When it was heard, as ``time.monotonic()`` [s].
        source: Who said it.
        message: What.
    """

    at: float
    source: str
    message: Estimate | Problem


class Watcher:
    """Hears all agents.

    Attributes:
        heard: All that they have said, but estimates that differ from the ones before in their numbers only.
        latest: The newest estimate of each.
        worst: Largest error of a mass that was called valid, in its own standard deviations.
    """

    def __init__(self, inbox: Inbox, mass: float) -> None:
        self.heard: list[Heard] = []
        self.latest: dict[str, Estimate] = {}
        self.worst = 0.0
        self._inbox = inbox
        self._mass = mass

    def listen(self, seconds: float) -> None:
        """Take in what comes within that time; return after the first message."""
        event = self._inbox.receive(seconds)
        if not isinstance(event, Received):
            return
        message = event.message
        if isinstance(message, Estimate):
            self._compare(message)
            before = self.latest.get(event.source)
            self.latest[event.source] = message
            if before is not None and (before.status, before.reasons) == (message.status, message.reasons):
                return
        assert isinstance(message, Estimate | Problem)
        self.heard.append(Heard(time.monotonic(), event.source, message))

    def _compare(self, estimate: Estimate) -> None:
        """Compare with the truth what an agent vouches for."""
        if estimate.status == "valid":
            assert estimate.payload is not None
            error = abs(estimate.payload.mass - self._mass)
            self.worst = max(self.worst, error / math.sqrt(estimate.payload.covariance[0, 0]))

    def wait_until(self, condition: Callable[[], bool], what: str, limit: float = LIMIT) -> float:
        """Listen until a condition comes true; return when it did."""
        deadline = time.monotonic() + limit
        while not condition():
            assert time.monotonic() < deadline, f"waited {limit:g} s for {what}; heard {self.told()}"
            self.listen(0.05)
        return time.monotonic()

    def all_are_valid(self, after_block: int = -1) -> bool:
        """Whether every agent's newest estimate is valid, and of a later block than that one."""
        return all(e.status == "valid" and e.block > after_block for e in self.latest.values())

    def wait_until_valid(self, after_block: int = -1, limit: float = LIMIT) -> float:
        """Wait until all estimates are; return when they were."""
        return self.wait_until(lambda: self.all_are_valid(after_block), "valid estimates", limit)

    def is_told(self, source: str, words: str, since: float) -> float | None:
        """When an agent first said so, as a problem or as the reason why its estimate is not valid; None if not."""
        for heard in self.heard:
            if heard.source == source and heard.at >= since and words in _words(heard.message):
                return heard.at
        return None

    def told(self) -> str:
        """The last things that were said."""
        return "\n".join(f"{heard.source}: {_words(heard.message)}" for heard in self.heard[-12:])


def _words(message: Estimate | Problem) -> str:
    if isinstance(message, Problem):
        return message.text
    return f"{message.status}: {'; '.join(message.reasons)}"


@contextmanager
def watching(team: Team) -> Iterator[Watcher]:
    """A watcher of a team, which has heard every agent."""
    inbox = Inbox()
    credentials = credentials_in(team.plan.keys, "observer") if team.plan.keys is not None else None
    guard = guard_observer(credentials, team.keys, "observer", team.plan.agents)
    with open_session(connect=[config.observe for config in team.plan.agents.values()], guard=guard) as session:
        for name in team.plan.agents:
            estimate, problem = (team.keys.observe_agent(name, topic) for topic in ("estimate", "problem"))
            inbox.listen(session, name, {estimate: Estimate, problem: Problem})
        watcher = Watcher(inbox, team.plan.server.scenario.payload.inertia().mass)
        watcher.wait_until(lambda: len(watcher.latest) == len(team.plan.agents), "all agents")
        yield watcher
