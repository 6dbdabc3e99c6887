"""The observer's link to a run: receives estimates and truth, and sends requests to the server."""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import zenoh

from coheft.app.names import check_link
from coheft.app.run.folder import RunFile, find_run
from coheft.app.run.news import News, check_news, check_status
from coheft.errors import CoheftError, LinkError, MessageError
from coheft.wire.messages.requests import (
    CutLinks,
    DisturbedLink,
    DisturbRequest,
    LinkRequest,
    Refusal,
    Request,
    Status,
    StatusRequest,
)
from coheft.wire.messages.structs import Estimate, EstimateBeside, Message, Problem
from coheft.wire.messages.truth import Scene, Truth
from coheft.wire.scenario.network import LinkQuality
from coheft.wire.transport.inbox import Inbox, Received, Refused
from coheft.wire.transport.planes import SERVER, guard_observer
from coheft.wire.transport.security import Guard, credentials_in
from coheft.wire.transport.sessions import Keys, Role, ask, open_session

_RETRY_EVERY = 0.02
_ANSWER_LIMIT = 5.0
_MAX_UNANSWERED = 5
"""Number of consecutive unanswered requests after which the server is given up; a busy machine may miss one or two."""
_COLLECT_LIMIT = 0.1  # so that ``collect`` returns even if messages arrive faster than they are read


class Observer:
    """Receives messages of the server and every agent of a run, see ``observe``."""

    def __init__(self, run_file: RunFile, session: zenoh.Session, role: Role) -> None:
        self._session = session
        self._keys = Keys(run_file.run)
        self._request = self._keys.request(role)
        self._inbox = Inbox()
        at_server = self._keys.observe_server
        self._last_word: Status | None = None
        self._unanswered = 0
        self._inbox.listen(
            session, SERVER, {at_server("truth"): Truth, at_server("problem"): Problem, at_server("end"): Status}
        )
        for name in run_file.agents:
            estimate, problem = (self._keys.observe_agent(name, topic) for topic in ("estimate", "problem"))
            self._inbox.listen(session, name, {estimate: Estimate | EstimateBeside, problem: Problem})

    def collect(self, scene: Scene, seconds: float, gather: float = 0.0) -> list[News]:
        """Wait at most ``seconds`` for a message, then return all that have arrived, checked and in order of arrival.

        Messages that arrive within ``gather`` seconds after the first are included. Invalid messages become a
        ``Problem``.
        """
        news: list[News] = []
        event = self._inbox.receive(seconds)
        if event is not None and gather > 0.0:
            time.sleep(gather)
        deadline = time.monotonic() + _COLLECT_LIMIT
        while event is not None:
            match event:
                case Received(source, message):
                    try:
                        checked = self._take(source, message, scene)
                    except MessageError as error:
                        checked = _refusal(source, error)
                    if checked is not None:
                        news.append(checked)
                case Refused(source, reason):
                    news.append(_refusal(source, reason))
            event = self._inbox.receive(0.0) if time.monotonic() < deadline else None
        return news

    def _take(self, source: str, message: Message, scene: Scene) -> News | None:
        """Check a message; keep the server's final status, and return other messages."""
        if not isinstance(message, Status):
            if source == SERVER:
                self._unanswered = 0
            return check_news(source, message, scene)
        check_status(message)
        self._last_word = message
        return None

    def status(self) -> Status | None:
        """Return the present or final status of the run; None if the server does not answer (yet, or any more).

        An invalid answer, for instance of a server of another release, raises a ``MessageError``.
        """
        if self._last_word is not None:
            return self._last_word
        try:
            answer = ask(Status, self._session, self._request, StatusRequest(), timeout=0.5)
        except LinkError:
            self._unanswered += 1
            return None
        self._unanswered = 0
        if isinstance(answer, Refusal):
            return None
        check_status(answer)
        return answer

    @property
    def has_ended(self) -> bool:
        """Whether the server has sent the final status."""
        return self._last_word is not None

    @property
    def has_lost_server(self) -> bool:
        """Whether the server has answered none of the last requests, nor sent anything since."""
        return self._unanswered >= _MAX_UNANSWERED

    def check_server(self) -> None:
        """Raise a ``LinkError`` if the server has been lost."""
        if self.has_lost_server:
            raise LinkError(f"the server has not answered {_MAX_UNANSWERED} requests in a row: it has ended, or hangs")

    def ask(self, request: Request) -> Status:
        """Send a request to the server, as soon as the link to it is up.

        It raises a ``LinkError`` without an answer, and a ``CoheftError`` if the server refuses, which says why.
        """
        silence = LinkError(f"the run's server does not answer within {_ANSWER_LIMIT:g} s")
        deadline = time.monotonic() + _ANSWER_LIMIT
        while self.status() is None:
            if time.monotonic() > deadline:
                raise silence
            time.sleep(_RETRY_EVERY)
        try:
            answer = ask(Status, self._session, self._request, request, timeout=_ANSWER_LIMIT)
        except LinkError as error:
            raise silence from error
        if isinstance(answer, Refusal):
            raise CoheftError(f"refused: {answer.reason}")
        check_status(answer)
        return answer


def _refusal(source: str, reason: MessageError) -> Problem:
    return Problem(source="observer", text=f"refused from {source}: {reason}")


@contextmanager
def observe(run_file: RunFile) -> Iterator[Observer]:
    """Dial the server and every agent of a run as an observer, while the context lasts.

    Without observer's keys, a secure run raises a ``CoheftError``.
    """
    endpoints = [run_file.server, *run_file.agents.values()]
    with open_session(connect=endpoints, guard=_guard(run_file, "observer")) as session:
        yield Observer(run_file, session, "observer")


def set_link(run_file: RunFile, scene: Scene, one: str, other: str, *, cut: bool) -> None:
    """Cut the link between two neighbours, or restore it, as the operator; errors are those of ``disturb_links``."""
    check_link(scene.neighbours, one, other)
    listens, dials = sorted((one, other), key=scene.robots.index)  # see ``coheft.app.run.plan.link_neighbours``
    _ask_agent(run_file, dials, LinkRequest(neighbour=listens, cut=cut), CutLinks)


def disturb_links(run_file: RunFile, scene: Scene, robot: str, other: str | None, quality: LinkQuality) -> None:
    """Let messages between a robot and a neighbour be lost or late, in both directions, as the operator.

    Without ``other``, that holds for all its neighbours; the default quality restores the links.

    Raises:
        CoheftError: There is no such robot or link, or the run is secure and there are no operator's keys.
        LinkError: An agent does not answer.
    """
    if other is not None:
        check_link(scene.neighbours, robot, other)
    elif robot not in scene.neighbours:
        raise CoheftError(f"there is no robot {robot}: the robots are {', '.join(scene.robots)}")
    for neighbour in scene.neighbours[robot] if other is None else [other]:
        for receiver, sender in ((robot, neighbour), (neighbour, robot)):
            _ask_agent(run_file, receiver, DisturbRequest(neighbour=sender, quality=quality), DisturbedLink)


def _ask_agent(run_file: RunFile, name: str, request: Message, expected: type[Message]) -> None:
    """Ask an agent as the operator, and wait for its answer."""
    key = Keys(run_file.run).request_agent(name)
    with open_session(connect=[run_file.agents[name]], guard=_guard(run_file, "operator")) as session:
        deadline = time.monotonic() + _ANSWER_LIMIT
        while True:
            try:
                answer = ask(expected, session, key, request, timeout=0.5)
                break
            except LinkError as error:  # the link to it may not be up yet
                if time.monotonic() > deadline:
                    raise LinkError(f"{name} does not answer within {_ANSWER_LIMIT:g} s") from error
                time.sleep(_RETRY_EVERY)
    if isinstance(answer, Refusal):
        raise CoheftError(f"refused: {answer.reason}")


def ask_run(request: Request, folder: Path | None) -> Status:
    """Send a request to the server of the run that ``find_run`` finds; errors are those of both."""
    return ask_server(find_run(folder, acts=not isinstance(request, StatusRequest)), request)


def ask_server(run_file: RunFile, request: Request) -> Status:
    """Send a request to the server of a run, as the operator.

    A ``CoheftError`` says why the server refuses, or that the run is secure and there are no operator's keys.
    """
    with open_session(connect=[run_file.server], guard=_guard(run_file, "operator")) as session:
        return Observer(run_file, session, "operator").ask(request)


def may_operate(run_file: RunFile) -> bool:
    """Whether this user can act as the operator: has the keys, if the run requires them."""
    if run_file.keys is None:
        return True
    try:
        return os.access(credentials_in(Path(run_file.keys), "operator").key, os.R_OK)
    except (CoheftError, PermissionError):
        return False


def _guard(run_file: RunFile, role: Role) -> Guard | None:
    credentials = credentials_in(Path(run_file.keys), role) if run_file.keys is not None else None
    return guard_observer(credentials, Keys(run_file.run), role, run_file.agents)
