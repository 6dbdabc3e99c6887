"""One agent in a process of its own: the pure core with its links.

``python -m agents.process`` reads an ``AgentProcessConfig`` from stdin.
"""

from __future__ import annotations

import os
import time
from collections import deque
from contextlib import ExitStack
from typing import NoReturn

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read when numpy is loaded: small products, many processes

import numpy as np
import zenoh
from msgspec import structs

from agents.agent import Agent
from coheft.errors import LinkError, MessageError
from coheft.estimation.measurement import SAMPLE_SIZE, MeasurementBlock
from coheft.wire.codec import check_field
from coheft.wire.config import AgentProcessConfig
from coheft.wire.inbox import Event, Inbox, LinkChange, Received, Refused
from coheft.wire.messages import Hello, Measurements, Message, NeighbourMessage, Ready, Stop
from coheft.wire.planes import guard_agent_for_observers, guard_neighbours, guard_robot
from coheft.wire.problem_log import ProblemLog
from coheft.wire.supervised import supervised_main
from coheft.wire.transport import Keys, Sender, open_session

HELLO_PERIOD = 0.05
"""Time after which a robot that waits for the first block says hello again [s]."""
_SERVER = "the server"


class _Stopped(Exception):  # noqa: N818
    """The server has said that the run is over."""


class AgentProcess:
    """An agent and its links: one session per plane, one inbox for all of them.

    At block k the agent steps with its measurements of block k and its neighbours' messages of block k - 1. What is
    malformed or unexpected is refused, counted and told to observers; the agent goes on waiting for what it needs.
    """

    def __init__(
        self,
        config: AgentProcessConfig,
        robot_plane: zenoh.Session,
        neighbour_plane: zenoh.Session,
        observer_plane: zenoh.Session,
    ) -> None:
        self._config = config.agent
        self._agent = Agent(config.agent)
        self._block = 0
        self._measurements: deque[Measurements] = deque()
        self._next_measurements = 0
        self._messages: dict[int, dict[str, NeighbourMessage]] = {}
        self._heard: set[str] = set()
        self._heard_by: set[str] = set()

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
        self._inbox.listen(
            robot_plane,
            _SERVER,
            {keys.robot(name, "measurements"): Measurements, keys.robot(name, "stop"): Stop},
        )
        for other in config.agent.neighbours:
            self._inbox.listen(
                neighbour_plane,
                other,
                {keys.agent(other, "hello"): Hello, keys.agent(other, "block"): NeighbourMessage},
            )

    def run(self) -> None:
        """Meet the neighbours, then answer block after block until the server says stop.

        Raises:
            LinkError: The link with the server is lost.
        """
        try:
            self._meet()
            while True:
                self._answer_block()
        except _Stopped:
            return

    def _meet(self) -> None:
        """Say hello until all neighbours hear us, then ready, both until the first block comes.

        A neighbour whose own neighbours are still on their way needs our hellos for as long.
        """
        next_hello = time.monotonic()
        while not self._measurements:
            wait = next_hello - time.monotonic()
            if wait > 0.0:
                self._handle(self._inbox.receive(wait))
                continue
            self._hello.send(Hello(sender=self._config.name, heard=sorted(self._heard)))
            if self._heard_by.issuperset(self._config.neighbours):
                self._ready.send(Ready(robot=self._config.name))
            next_hello = time.monotonic() + HELLO_PERIOD

    def _answer_block(self) -> None:
        """Wait for all that belongs to one block, step, and say what came of it."""
        block = self._block
        expected = set(self._config.neighbours) if block > 0 else set()
        while not self._measurements or expected - self._messages.get(block - 1, {}).keys():
            self._handle(self._inbox.receive())
        measured = self._usable(self._measurements.popleft())
        heard = self._messages.pop(block - 1, {})
        outbox = self._agent.step(block, measured, list(heard.values()))
        self._block += 1
        for problem in outbox.problems:
            self._problems.tell(problem)
        self._message.send(outbox.message)
        if outbox.estimate is not None:
            self._estimate.send(structs.replace(outbox.estimate, problems=self._problems.count))
        self._reference.send(outbox.reference)

    def _usable(self, measurements: Measurements) -> MeasurementBlock | None:
        """The block for the core; None if a sensor failed."""
        if np.isfinite(measurements.samples).all():
            return MeasurementBlock(measurements.block, measurements.samples)
        self._problems.tell(f"measurements of block {measurements.block} are not all finite: the block is not used")
        return None

    def _handle(self, event: Event | None) -> None:
        """Take in whatever came.

        Raises:
            LinkError: The link with the server is lost.
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
            case LinkChange(source, links=0):
                raise LinkError(f"{self._config.name} lost its link with {source} at block {self._block}")

    def _take(self, source: str, message: Message) -> None:
        """Put a message where it is waited for.

        Raises:
            MessageError: Nobody waits for it.
            _Stopped: It says stop.
        """
        match message:
            case Measurements():
                self._check_measurements(message)
                self._measurements.append(message)
                self._next_measurements += 1
            case NeighbourMessage():
                self._check_neighbour_message(source, message)
                self._messages.setdefault(message.block, {})[source] = message
            case Hello():
                check_field("sender", message.sender, source)
                self._heard.add(source)
                if self._config.name in message.heard:
                    self._heard_by.add(source)
            case Stop():
                raise _Stopped

    def _check_measurements(self, message: Measurements) -> None:
        check_field("robot", message.robot, self._config.name)
        check_field("block", message.block, self._next_measurements)
        check_field("samples.shape", message.samples.shape, (self._config.block, SAMPLE_SIZE))

    def _check_neighbour_message(self, source: str, message: NeighbourMessage) -> None:
        check_field("sender", message.sender, source)
        # A neighbour needs our message of a block to get past the next one, so it is at most one block ahead.
        expected = [b for b in (self._block - 1, self._block) if b >= 0 and source not in self._messages.get(b, {})]
        if message.block not in expected:
            raise MessageError(f"block is {message.block} but expected one of {expected}")


def run_agent(config: AgentProcessConfig) -> None:
    """Run an agent until the server says stop.

    Raises:
        LinkError: Somebody listens at one of its endpoints already, or the link with the server is lost.
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
