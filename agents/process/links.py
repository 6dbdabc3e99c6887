"""The network links of an agent's process on its three planes, with outgoing and incoming messages."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from typing import TYPE_CHECKING

import zenoh

from coheft.errors import MessageError
from coheft.wire.config import AgentProcessConfig
from coheft.wire.messages.requests import CutLinks, DisturbedLink, DisturbRequest, LinkRequest, Refusal
from coheft.wire.messages.size import LEAST_LIMIT
from coheft.wire.messages.structs import Hello, Message, Stop
from coheft.wire.process.problem_log import ProblemLog
from coheft.wire.transport.dialled import DialledLink
from coheft.wire.transport.inbox import Event, Inbox, Presence, Question, Received, Refused
from coheft.wire.transport.planes import guard_agent_for_observers, guard_neighbours, guard_robot
from coheft.wire.transport.security import Credentials
from coheft.wire.transport.sessions import Keys, Sender, open_session, session_id

if TYPE_CHECKING:  # not loaded by robots without a cart
    from coheft.wire.cart.config import CartAgentProcessConfig

SERVER = "the server"
"""Name of the server in events."""
HELLO_PERIOD = 0.05
"""Time after which a robot that waits for measurements repeats its hello [s]."""


class Stopped(Exception):  # noqa: N818
    """Raised when the server has ended the run."""


class AgentLinks:
    """An agent's links: one session for each party that it dials, and one per plane for incoming connections.

    ``receive`` returns the next event, see ``Inbox.receive``. ``ready`` and ``reference`` send to the server, ``hello``
    and ``message`` to all neighbours, ``estimate`` to observers, ``problems`` to observers and to the log.

    Args:
        stack: Closes the sessions when it is left.
        config: The agent's endpoints, neighbours and run.
        measurements: Type of the server's measurements.
        from_neighbours: Type of the neighbours' messages of each block.
        security: Keys and certificates of the secure profile; None for the open one.
        largest: Size limit of messages from neighbours [B].

    Raises:
        LinkError: An endpoint is malformed, or another process listens at it.
    """

    def __init__(
        self,
        stack: ExitStack,
        config: AgentProcessConfig | CartAgentProcessConfig,
        measurements: type[Message],
        from_neighbours: type[Message],
        security: Credentials | None,
        largest: int,
    ) -> None:
        name, others, keys = config.agent.name, config.agent.neighbours, Keys(config.run)
        inbox = Inbox()
        self.receive = inbox.receive
        self.ready = Sender(None, keys.robot(name, "ready"), may_drop=False)
        self.reference = Sender(None, keys.robot(name, "reference"), may_drop=False)
        self.hello = Sender(None, keys.agent(name, "hello"), may_drop=False)
        self.message = Sender(None, keys.agent(name, "block"), may_drop=False)

        def receive_from_server(session: zenoh.Session) -> None:
            inbox.watch_links(session, SERVER)
            inbox.listen(
                session, SERVER, {keys.robot(name, "measurements"): measurements, keys.robot(name, "stop"): Stop}
            )

        def receive_from_neighbours(session: zenoh.Session, *whom: str) -> None:
            inbox.announce(session, keys.agent(name, "alive"))
            for other in whom:
                inbox.watch_presence(session, other, keys.agent(other, "alive"))
                inbox.listen(
                    session, other, {keys.agent(other, "hello"): Hello, keys.agent(other, "block"): from_neighbours}
                )

        def dial_neighbour(other: str, endpoint: str) -> DialledLink:
            guard = guard_neighbours(security, keys, name, [other])
            return DialledLink(
                endpoint,
                guard,
                inbox,
                lambda session: receive_from_neighbours(session, other),
                [self.hello, self.message],
                largest,
            )

        guard = guard_robot(security, keys, name)
        server = DialledLink(config.server, guard, inbox, receive_from_server, [self.ready, self.reference])
        self._server = stack.enter_context(closing(server))
        dialled = {other.name: other.endpoint for other in config.neighbours if other.endpoint is not None}
        guard = guard_neighbours(security, keys, name, others)
        listening = stack.enter_context(open_session([config.listen], guard=guard, largest=largest))
        inbox.watch_strangers(listening, guard)
        receive_from_neighbours(listening, *(other for other in others if other not in dialled))
        self.hello.attach(listening)
        self.message.attach(listening)
        self._listening = session_id(listening)
        self._neighbours = {
            other: stack.enter_context(closing(dial_neighbour(other, endpoint))) for other, endpoint in dialled.items()
        }
        self._cut: set[str] = set()

        guard = guard_agent_for_observers(security, keys, name)
        observers = stack.enter_context(open_session(listen=[config.observe], guard=guard))
        inbox.watch_strangers(observers, guard)
        inbox.serve(observers, {keys.request_agent(name): "operator"}, LinkRequest | DisturbRequest)
        self._name, self._names = name, list(others)
        self.estimate = Sender(observers, keys.observe_agent(name, "estimate"), may_drop=True)
        self.problems = ProblemLog(name, Sender(observers, keys.observe_agent(name, "problem"), may_drop=True))

    def handle(self, event: Event | None, take: Callable[[str, Message], None]) -> Presence | DisturbRequest | None:
        """Process an event: give its message to ``take`` and report the ``MessageError`` that this may raise, report
        what is refused, return a change of a link.

        Raises:
            Stopped: The server has ended the run.
        """
        if isinstance(event, Received):  # by far the most events
            if isinstance(event.message, Stop):
                raise Stopped
            try:
                take(event.source, event.message)
            except MessageError as error:
                self.problems.tell(f"refused from {event.source}: {error}")
            return None
        match event:
            case Refused(source, reason):
                self.problems.tell(f"refused from {source}: {reason}")
            case Presence() if event.session == self._session_with(event.source):
                return event
            case Question(_, LinkRequest() as request):
                return self._answer(event, request)
            case Question(_, DisturbRequest() as request):
                return self._disturb(event, request)
        return None

    def _answer(self, question: Question, request: LinkRequest) -> Presence | None:
        """Cut or restore a link as the operator requests; a cut link looks as if the neighbour had left."""
        other = request.neighbour
        if other not in self._neighbours:
            dialled = ", ".join(self._neighbours) or "no neighbour"
            question.answer(
                Refusal(reason=f"{self._name} dials {dialled}: only the robot that dials {other} can cut that link")
            )
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

    def _disturb(self, question: Question, request: DisturbRequest) -> DisturbRequest | None:
        """Accept that messages of a neighbour are to be lost or late."""
        if request.neighbour not in self._names:
            reason = f"{request.neighbour} is no neighbour of {self._name}; these are {', '.join(self._names)}"
            question.answer(Refusal(reason=reason))
            return None
        question.answer(DisturbedLink(robot=self._name, neighbour=request.neighbour, quality=request.quality))
        done, how = ("restored", "") if request.quality.is_ideal else ("disturbed", f": {request.quality.in_words}")
        self.problems.tell(f"the operator has {done} the link from {request.neighbour}{how}")
        return request

    def _session_with(self, party: str) -> str:
        link = self._server if party == SERVER else self._neighbours.get(party)
        return self._listening if link is None else link.session

    @property
    def dialled(self) -> frozenset[str]:
        """Neighbours that this agent dials, except those whose link the operator has cut."""
        return frozenset(self._neighbours) - self._cut

    def redial(self, party: str) -> None:
        """Renew the link to the server, or to a neighbour that this agent dials."""
        (self._server if party == SERVER else self._neighbours[party]).renew()


@contextmanager
def open_links(
    config: AgentProcessConfig | CartAgentProcessConfig,
    measurements: type[Message],
    from_neighbours: type[Message],
    security: Credentials | None = None,
    largest: int = LEAST_LIMIT,
) -> Iterator[AgentLinks]:
    """Open an agent's links, until the server ends the run.

    They receive messages of two types from the server and from neighbours, apart from hello, of at most ``largest``
    [B]. Without credentials the profile is open.

    Raises:
        LinkError: Another process listens at one of the agent's endpoints.
    """
    with ExitStack() as stack:
        links = AgentLinks(stack, config, measurements, from_neighbours, security, largest)
        with suppress(Stopped):
            yield links
