"""A robot's own driver in place of the physics server: sends measurements to one agent, and receives its references.

It listens at the endpoint at which the agent dials its server, so that the agent runs unchanged. One loop per robot::

    with open_driver(config) as driver:
        driver.wait_for_agent()
        for block in itertools.count():
            reference = driver.reference(block)
            ...  # move the arm, read the sensors
            driver.send(block, samples)
"""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import zenoh

from coheft.errors import LinkError, MessageError
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import SAMPLE_SIZE
from coheft.wire.config import AgentProcessConfig
from coheft.wire.messages.codec import check_numbers
from coheft.wire.messages.structs import Measurements, Reference
from coheft.wire.process.log import LOG
from coheft.wire.transport.inbox import Inbox, Presence, Received, Refused
from coheft.wire.transport.planes import guard_server_for_robot
from coheft.wire.transport.robot_link import RobotLink
from coheft.wire.transport.security import Credentials
from coheft.wire.transport.sessions import Keys, open_session

_TICK = 0.5


class Driver:
    """The sensors and the arm of one robot, see ``open_driver``. Not thread-safe: use it in one thread.

    Methods that wait for the agent raise a ``LinkError`` after ``seconds``.

    Attributes:
        name: The robot's name.
        rate: Samples per second that the agent expects.
        samples: Samples per block that the agent expects.
    """

    def __init__(self, config: AgentProcessConfig, session: zenoh.Session, inbox: Inbox) -> None:
        self.name = config.agent.name
        self.rate = config.agent.rate
        self.samples = config.agent.block
        self._lag = config.agent.lag
        self._inbox = inbox
        self._next = 0
        self._link = RobotLink(
            self.name,
            session,
            inbox,
            Keys(config.run),
            world=time.time_ns(),
            lag=self._lag,
            block=self.samples,
        )

    def wait_for_agent(self, seconds: float = math.inf) -> None:
        """Wait until the agent can receive measurements and is linked with all its neighbours."""
        self._wait(lambda: self._link.is_settled, seconds, "is not ready")

    def reference(self, block: int, seconds: float = 10.0) -> Reference | None:
        """Return what the arm shall do during a block, when the agent has answered the block that determines it.

        It is None for the first blocks, or if there is none: the arm then has to hold its position.
        """
        wanted = block - self._lag
        self._wait(lambda: self._link.is_ready and self._link.answered >= wanted, seconds, f"has not answered {wanted}")
        return self._link.take_reference(block)

    def send(self, block: int, samples: Array) -> None:
        """Send the agent its measurements of a block: samples (B, 15), columns as in ``MeasurementBlock``.

        Force comes before torque; recordings have the moment first, which ``coheft.estimators.samples_of`` converts.
        Block k, the same for all robots, holds the samples from ``k B / rate`` seconds on. Samples of another shape, or
        that are not finite, are a ``MessageError``.
        """
        samples = np.array(samples, dtype=np.float64)  # estimators compute in double precision
        check_numbers(samples, (self.samples, SAMPLE_SIZE), f"samples of block {block}")
        self._next = block + 1
        self._link.send_measurements(Measurements(robot=self.name, block=block, samples=samples))

    def finish(self, seconds: float = 10.0) -> None:
        """Wait for the answer to the last block."""
        self._wait(lambda: not self._link.owes_answer, seconds, "has not answered the last block")

    def stop(self, reason: str) -> None:
        """Tell the agent that the run is over, which ends its process."""
        self._link.send_stop(reason)

    def _wait(self, condition: Callable[[], bool], seconds: float, what: str) -> None:
        deadline = time.monotonic() + seconds
        self._receive(0.0)
        while not condition():
            left = deadline - time.monotonic()
            if left <= 0.0:
                raise LinkError(f"the agent of {self.name} {what} within {seconds:g} s")
            self._receive(min(left, _TICK))

    def _receive(self, seconds: float) -> None:
        match self._inbox.receive(seconds):
            case Received(_, message):
                was_ready = self._link.is_ready
                try:
                    self._link.take(message)
                except MessageError as error:
                    LOG.warning("refused from %s: %s", self.name, error)
                if self._link.is_ready and not was_ready:
                    self._link.join(self._next)
            case Refused(source, error):
                LOG.warning("refused from %s: %s", source, error)
            case Presence(is_here=is_here):
                self._link.note_link(is_here)


@contextmanager
def open_driver(config: AgentProcessConfig, credentials: Credentials | None = None) -> Iterator[Driver]:
    """Listen at the endpoint at which the agent of this configuration dials its server.

    The configuration is one of ``coheft run --write-configs``. In the secure profile, ``credentials`` are the server's,
    see ``credentials_in``. If another process listens there, that is a ``LinkError``.
    """
    name, inbox = config.agent.name, Inbox()
    guard = guard_server_for_robot(credentials, Keys(config.run), name)
    with open_session(listen=[config.server], guard=guard) as session:
        driver = Driver(config, session, inbox)
        inbox.watch_links(session, name, guard)
        inbox.watch_strangers(session, guard)
        yield driver
