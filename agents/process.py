"""One agent in a process of its own: the pure core with its links.

``python -m agents.process`` reads an ``AgentProcessConfig`` from stdin.
"""

from __future__ import annotations

import math
import os
import time
from collections import deque
from contextlib import ExitStack
from typing import NoReturn

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read when numpy is loaded: small products, many processes

import zenoh
from msgspec import structs

from agents.agent import Agent
from agents.neighbour_link import NeighbourLink
from coheft.errors import LinkError, MessageError
from coheft.estimation.measurement import SAMPLE_SIZE, MeasurementBlock
from coheft.wire.codec import check_field
from coheft.wire.config import AgentProcessConfig
from coheft.wire.inbox import Event, Inbox, LinkChange, Presence, Received, Refused
from coheft.wire.messages import Estimate, Hello, Measurements, Message, NeighbourMessage, Ready, Stop
from coheft.wire.planes import guard_agent_for_observers, guard_neighbours, guard_robot
from coheft.wire.problem_log import ProblemLog
from coheft.wire.supervised import supervised_main
from coheft.wire.transport import Keys, Sender, open_session

HELLO_PERIOD = 0.05
"""Time after which a robot that waits for measurements says hello again [s]."""
_SERVER = "the server"
_BACKLOG = 64
"""Blocks of measurements that may wait; an agent that is slower for longer than that skips the oldest."""
_AT_ONCE = 256
"""So much is read between two steps at most: somebody may speak faster than can be read."""


class _Stopped(Exception):  # noqa: N818
    """The server has said that the run is over."""


class AgentProcess:
    """An agent and its links: one session per plane, one inbox for all of them.

    The agent steps when it has measurements of a block k, and of every neighbour that keeps pace the message of block
    k - 1; a neighbour whose link is gone does not, nor one for whose message it once waited longer than its patience,
    until it is heard in time again. So nobody can hold it up, and while nothing fails, equal runs take equal steps.

    It asks for measurements when it starts, and again whenever it has lost the server. If it is a new server that
    comes, with a new world, the agent forgets everything and starts again.
    """

    def __init__(
        self,
        config: AgentProcessConfig,
        robot_plane: zenoh.Session,
        neighbour_plane: zenoh.Session,
        observer_plane: zenoh.Session,
    ) -> None:
        self._config = config
        self._links = {name: NeighbourLink(name) for name in config.agent.neighbours}
        self._measurements: deque[tuple[float, Measurements]] = deque(maxlen=_BACKLOG)
        self._world: int | None = None
        self._attempt = time.time_ns()
        self._is_fed = False
        self._server_lost_at: float | None = None
        self._said_hello_at = -math.inf
        self._start_agent()

        name, keys = config.agent.name, Keys(config.run)
        self._ready = Sender(robot_plane, keys.robot(name, "ready"), may_drop=False)
        self._reference = Sender(robot_plane, keys.robot(name, "reference"), may_drop=False)
        self._hello = Sender(neighbour_plane, keys.agent(name, "hello"), may_drop=False)
        self._message = Sender(neighbour_plane, keys.agent(name, "block"), may_drop=False)
        self._estimate = Sender(observer_plane, keys.observe_agent(name, "estimate"), may_drop=True)
        self._problems = ProblemLog(name, Sender(observer_plane, keys.observe_agent(name, "problem"), may_drop=True))
        self._inbox = Inbox()
        self._inbox.watch_links(robot_plane, _SERVER)
        self._inbox.watch_strangers(
            neighbour_plane, guard_neighbours(config.security, keys, name, config.agent.neighbours)
        )
        self._inbox.watch_strangers(observer_plane, guard_agent_for_observers(config.security, keys, name))
        self._inbox.listen(
            robot_plane,
            _SERVER,
            {keys.robot(name, "measurements"): Measurements, keys.robot(name, "stop"): Stop},
        )
        self._inbox.announce(neighbour_plane, keys.agent(name, "alive"))
        for other in config.agent.neighbours:
            self._inbox.watch_presence(neighbour_plane, other, keys.agent(other, "alive"))
            self._inbox.listen(
                neighbour_plane,
                other,
                {keys.agent(other, "hello"): Hello, keys.agent(other, "block"): NeighbourMessage},
            )

    def _start_agent(self) -> None:
        """An agent that knows nothing yet, in the place of the one before."""
        self._incarnation = time.time_ns()
        self._agent = Agent(self._config.agent, self._incarnation)
        self._block = -1
        self._last_estimate: Estimate | None = None

    def run(self) -> None:
        """Answer block after block until the server says stop.

        Raises:
            LinkError: The server is gone and does not come back.
        """
        try:
            while True:
                self._wait_for_measurements()
                self._wait_for_neighbours()
                if self._measurements:
                    self._step(self._measurements.popleft()[1])
        except _Stopped:
            return

    def _wait_for_measurements(self) -> None:
        """Take in what has come, and wait for measurements; while nobody sends any, ask for them.

        Raises:
            LinkError: The server is gone for too long.
        """
        for _ in range(_AT_ONCE):
            event = self._inbox.receive(0.0)
            if event is None:
                break
            self._handle(event)
        next_request = time.monotonic()
        while not self._measurements:
            if self._is_fed:
                self._handle(self._inbox.receive())
            elif (wait := next_request - time.monotonic()) > 0.0:
                self._handle(self._inbox.receive(wait))
            else:
                self._ask_for_measurements()
                next_request = time.monotonic() + HELLO_PERIOD

    def _ask_for_measurements(self) -> None:
        """Say hello, so that neighbours know that we hear them, and ask the server."""
        if self._server_lost_at is not None and time.monotonic() - self._server_lost_at > self._config.server_limit:
            raise LinkError(
                f"{self._name} lost its link with {_SERVER} at block {self._block}, and it did not come back "
                f"within {self._config.server_limit:g} s"
            )
        self._say_hello()
        missing = [name for name, link in self._links.items() if not link.hears_us]
        self._ready.send(Ready(robot=self._name, missing=missing, attempt=self._attempt))

    def _answer_hello(self) -> None:
        """Tell neighbours whom we hear, unless we have just done so."""
        if time.monotonic() - self._said_hello_at > HELLO_PERIOD / 2:
            self._say_hello()

    def _say_hello(self) -> None:
        self._said_hello_at = time.monotonic()
        heard = [name for name, link in self._links.items() if link.is_heard]
        self._hello.send(Hello(sender=self._name, heard=heard, incarnation=self._incarnation))

    def _wait_for_neighbours(self) -> None:
        """Wait until nobody is missing for the step, or there is no step to take, or patience ends."""
        while self._measurements:
            arrival, measurements = self._measurements[0]
            missing = [link for link in self._links.values() if link.is_missing(measurements.block)]
            left = arrival + self._config.patience - time.monotonic()
            if not missing:
                return
            if left > 0.0:
                self._handle(self._inbox.receive(left))
                continue
            for link in missing:
                link.keeps_pace = False

    def _step(self, measurements: Measurements) -> None:
        """Step with all that is there, and say what came of it."""
        self._tell_of_links()
        is_first, self._block = self._block < 0, measurements.block
        messages = [message for link in self._links.values() for message in link.take_messages(self._block)]
        outbox = self._agent.step(self._block, MeasurementBlock(self._block, measurements.samples), messages)
        self._message.send(outbox.message)
        if outbox.estimate is not None:
            self._last_estimate = structs.replace(outbox.estimate, problems=self._problems.count)
            self._estimate.send(self._last_estimate)
        self._reference.send(outbox.reference)
        for problem in outbox.problems:
            self._problems.tell(problem)
        if is_first:  # those whom it has met begin with the same block
            for link in self._links.values():
                link.keeps_pace = link.is_heard

    def _handle(self, event: Event | None) -> None:
        """Take in whatever came.

        Raises:
            _Stopped: The server said so.
        """
        match event:
            case Received(source, message):
                try:
                    self._take(source, message)
                except MessageError as error:
                    self._problems.tell(f"refused from {source}: {error}")
            case Refused(source, error):
                self._problems.tell(f"refused from {source}: {error}")
            case LinkChange(links=count):
                self._note_server_links(count)
            case Presence(source, is_here):
                self._links[source].note_presence(is_here)

    def _take(self, source: str, message: Message) -> None:
        """Put a message where it is waited for.

        Raises:
            MessageError: It does not fit here and now.
            _Stopped: It says stop.
        """
        match message:
            case Measurements():
                if message.attempt == self._attempt:
                    self._take_measurements(message)
            case NeighbourMessage():
                check_field("sender", message.sender, source)
                self._links[source].take_message(message, self._next_block)
            case Hello():
                check_field("sender", message.sender, source)
                self._links[source].take_hello(message, self._name)
                if self._is_fed and not self._links[source].hears_us:
                    self._answer_hello()
            case Stop():
                raise _Stopped

    def _take_measurements(self, message: Measurements) -> None:
        """Keep measurements for their step; those of a new world are for a new agent.

        Raises:
            MessageError: They are not ours, or of an old block, or of the wrong shape.
        """
        check_field("robot", message.robot, self._name)
        check_field("samples.shape", message.samples.shape, (self._config.agent.block, SAMPLE_SIZE))
        if message.world != self._world:
            if self._world is not None:
                self._problems.tell("the server has started again: so does this agent")
                self._start_agent()
            self._world = message.world
        newest = self._measurements[-1][1].block if self._measurements else self._block
        if message.block <= newest:
            raise MessageError(f"block is {message.block} but expected one after {newest}")
        self._is_fed = True
        self._measurements.append((time.monotonic(), message))

    def _note_server_links(self, count: int) -> None:
        """A lost server is told to observers, and asked again as soon as it is back."""
        if count > 0:
            self._server_lost_at = None
        elif self._server_lost_at is None:
            self._server_lost_at = time.monotonic()
            self._attempt = time.time_ns()
            self._is_fed = False
            self._measurements.clear()
            for link in self._links.values():
                link.forget()
            text = f"lost the link with {_SERVER} after block {self._block}"
            self._problems.tell(text)
            if self._last_estimate is not None and self._last_estimate.status == "valid":
                self._estimate.send(structs.replace(self._last_estimate, status="stale", reasons=[text]))

    def _tell_of_links(self) -> None:
        """Tell observers of neighbours that have fallen silent, or are back.

        Only between steps: neighbours that go when the run is over have not fallen silent.
        """
        for link in self._links.values():
            if link.take_change() and self._block >= 0:
                self._problems.tell(
                    f"{link.name} is {'back' if link.is_linked else 'silent'}, after block {self._block}"
                )

    @property
    def _name(self) -> str:
        return self._config.agent.name

    @property
    def _next_block(self) -> int:
        return self._measurements[0][1].block if self._measurements else self._block + 1


def run_agent(config: AgentProcessConfig) -> None:
    """Run an agent until the server says stop.

    Raises:
        LinkError: Somebody listens at one of its endpoints already, or the server is gone and does not come back.
    """
    dialled = [neighbour.endpoint for neighbour in config.neighbours if neighbour.endpoint is not None]
    name, keys, own = config.agent.name, Keys(config.run), config.security
    with ExitStack() as stack:
        robot_plane = stack.enter_context(open_session(connect=[config.server], guard=guard_robot(own, keys, name)))
        neighbour_plane = stack.enter_context(
            open_session([config.listen], dialled, guard_neighbours(own, keys, name, config.agent.neighbours))
        )
        observer_plane = stack.enter_context(
            open_session(listen=[config.observe], guard=guard_agent_for_observers(own, keys, name))
        )
        AgentProcess(config, robot_plane, neighbour_plane, observer_plane).run()


def main() -> NoReturn:
    """Run the agent whose configuration comes on stdin."""
    supervised_main(AgentProcessConfig, run_agent)


if __name__ == "__main__":
    main()
