"""The links of an agent's process on its three planes, with outgoing and incoming messages."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING

import zenoh

from coheft.errors import MessageError
from coheft.wire.config import AgentProcessConfig
from coheft.wire.messages.requests import CutLinks, LinkRequest, Refusal
from coheft.wire.messages.size import LEAST_LIMIT
from coheft.wire.messages.structs import Hello, Message, Stop
from coheft.wire.process.problem_log import ProblemLog
from coheft.wire.transport.dialled import DialledLink
from coheft.wire.transport.inbox import Event, Inbox, LinkChange, Presence, Question, Received, Refused
from coheft.wire.transport.planes import guard_agent_for_observers, guard_neighbours, guard_robot
from coheft.wire.transport.security import Credentials
from coheft.wire.transport.sessions import Keys, Sender, open_session, session_id

if TYPE_CHECKING:  # robots without a cart need not load it
    from coheft.wire.cart.config import CartAgentProcessConfig

SERVER = "the server"
"""What the server is called in events."""
HELLO_PERIOD = 0.05
"""Time after which a robot that waits for measurements says hello again [s]."""


class Stopped(Exception):  # noqa: N818
    """The server has said that the run is over."""


class AgentLinks:
    """An agent's links: a session for each party that it connects to, and one on each plane for incoming connections.

    Attributes:
        ready: To the server, like ``reference``.
        reference: To the server.
        hello: To all neighbours, like ``message``.
        message: To all neighbours.
        estimate: To observers.
        problems: To observers and the log.
    """

    def __init__(
        self,
        stack: ExitStack,
        config: AgentProcessConfig | CartAgentProcessConfig,
        measurements: type[Message],
        said: type[Message],
        security: Credentials | None,
        largest: int,
    ) -> None:
        name, others, keys = config.agent.name, config.agent.neighbours, Keys(config.run)
        self._inbox = inbox = Inbox()
        self.ready = Sender(None, keys.robot(name, "ready"), may_drop=False)
        self.reference = Sender(None, keys.robot(name, "reference"), may_drop=False)
        self.hello = Sender(None, keys.agent(name, "hello"), may_drop=False)
        self.message = Sender(None, keys.agent(name, "block"), may_drop=False)

        def hear_server(session: zenoh.Session) -> None:
            inbox.watch_links(session, SERVER)
            kinds: dict[str, type[Message]] = {
                keys.robot(name, "measurements"): measurements,
                keys.robot(name, "stop"): Stop,
            }
            inbox.listen(session, SERVER, kinds)

        def hear_neighbours(session: zenoh.Session, *whom: str) -> None:
            inbox.announce(session, keys.agent(name, "alive"))
            for other in whom:
                inbox.watch_presence(session, other, keys.agent(other, "alive"))
                inbox.listen(session, other, {keys.agent(other, "hello"): Hello, keys.agent(other, "block"): said})

        def dial_neighbour(other: str, endpoint: str) -> DialledLink:
            guard = guard_neighbours(security, keys, name, [other])
            return DialledLink(
                endpoint,
                guard,
                inbox,
                lambda session: hear_neighbours(session, other),
                self.hello,
                self.message,
                largest=largest,
            )

        def dial(link: DialledLink) -> DialledLink:
            stack.callback(link.close)
            return link

        guard = guard_robot(security, keys, name)
        self._server = dial(DialledLink(config.server, guard, inbox, hear_server, self.ready, self.reference))
        dialled = {other.name: other.endpoint for other in config.neighbours if other.endpoint is not None}
        guard = guard_neighbours(security, keys, name, others)
        dialled_in = stack.enter_context(open_session([config.listen], guard=guard, largest=largest))
        inbox.watch_strangers(dialled_in, guard)
        hear_neighbours(dialled_in, *(other for other in others if other not in dialled))
        self.hello.attach(dialled_in)
        self.message.attach(dialled_in)
        self._dialled_in = session_id(dialled_in)
        self._neighbours = {other: dial(dial_neighbour(other, endpoint)) for other, endpoint in dialled.items()}
        self._cut: set[str] = set()

        guard = guard_agent_for_observers(security, keys, name)
        observers = stack.enter_context(open_session(listen=[config.observe], guard=guard))
        inbox.watch_strangers(observers, guard)
        inbox.serve(observers, {keys.request_agent(name): "operator"}, LinkRequest)
        self._name = name
        self.estimate = Sender(observers, keys.observe_agent(name, "estimate"), may_drop=True)
        self.problems = ProblemLog(name, Sender(observers, keys.observe_agent(name, "problem"), may_drop=True))

    def receive(self, timeout: float | None = None) -> Event | None:
        """The next thing that comes, or None if nothing does within ``timeout`` [s] (None: wait without limit)."""
        return self._inbox.receive(timeout)

    def sort(self, event: Event | None, take: Callable[[str, Message], None]) -> LinkChange | Presence | None:
        """Hand a message on, tell of what is refused, and give back what is news of a link.

        Args:
            event: What came.
            take: Takes a message, with its source; what it does not accept is told.

        Raises:
            Stopped: The server said so.
        """
        match event:
            case Received(_, Stop()):
                raise Stopped
            case Received(source, message):
                try:
                    take(source, message)
                except MessageError as error:
                    self.problems.tell(f"refused from {source}: {error}")
            case Refused(source, error):
                self.problems.tell(f"refused from {source}: {error}")
            case LinkChange() if event.session == self._server.session:
                return event
            case Presence() if event.session == self._session_with(event.source):
                return event
            case Question(_, LinkRequest() as request):
                return self._answer(event, request)
        return None

    def _answer(self, question: Question, request: LinkRequest) -> Presence | None:
        """Cut a link, or mend it; one that is cut looks as if the neighbour had gone."""
        other = request.neighbour
        if other not in self._neighbours:
            dialled = ", ".join(self._neighbours) or "no one"
            question.answer(Refusal(reason=f"{self._name} dials {dialled}: only who dials {other} can cut that link"))
            return None
        has_changed = request.cut != (other in self._cut)
        if has_changed and request.cut:
            self._cut.add(other)
            self._neighbours[other].hang_up()
        elif has_changed:
            self._cut.discard(other)
            self._neighbours[other].renew()
        question.answer(CutLinks(robot=self._name, neighbours=sorted(self._cut)))
        if not has_changed:
            return None
        self.problems.tell(f"the operator has {'cut' if request.cut else 'mended'} the link with {other}")
        return Presence(other, False) if request.cut else None

    def _session_with(self, neighbour: str) -> str:
        link = self._neighbours.get(neighbour)
        return self._dialled_in if link is None else link.session

    @property
    def dialled(self) -> frozenset[str]:
        """Neighbours that this agent connects to, unless the operator has cut the link."""
        return frozenset(self._neighbours) - self._cut

    def redial(self, party: str) -> None:
        """Renew the link to the server, or to a neighbour that this agent connects to."""
        (self._server if party == SERVER else self._neighbours[party]).renew()


@contextmanager
def open_links(
    config: AgentProcessConfig | CartAgentProcessConfig,
    measurements: type[Message],
    said: type[Message],
    security: Credentials | None = None,
    largest: int = LEAST_LIMIT,
) -> Iterator[AgentLinks]:
    """An agent's links, until the server says stop.

    Args:
        config: Where to dial and listen.
        measurements: What the server sends.
        said: What neighbours say, besides hello.
        security: Credentials; None: the open profile.
        largest: What neighbours may say in one message [B].

    Raises:
        LinkError: Somebody listens at one of its endpoints already.
    """
    with ExitStack() as stack:
        links = AgentLinks(stack, config, measurements, said, security, largest)
        with suppress(Stopped):
            yield links
