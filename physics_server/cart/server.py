"""The process of the cart's physics, in lockstep with the pushers.

``python -m coheft.physics_server.cart.server`` reads a ``CartServerConfig`` from stdin.
"""

import time
from contextlib import ExitStack
from typing import NoReturn

import zenoh

from coheft.errors import CoheftError, LinkError, MessageError
from coheft.physics_server.cart.physics import CartSimulation
from coheft.wire.cart.config import CartServerConfig
from coheft.wire.cart.messages import CartPush
from coheft.wire.messages.codec import check_field, check_numbers
from coheft.wire.messages.structs import Message, Ready, Stop
from coheft.wire.process.problem_log import ProblemLog
from coheft.wire.process.supervised import supervised_main
from coheft.wire.transport.inbox import Event, Inbox, Presence, Received, Refused
from coheft.wire.transport.planes import SERVER
from coheft.wire.transport.sessions import Keys, Sender, open_session

_ANSWER_LIMIT = 30.0
"""Time without an answer after which the run ends [s]."""


class _PusherLink:
    """One pusher's session, and the state of the communication with it.

    Attributes:
        is_ready: Whether its links are up and it receives the server's messages.
        answered: The last sample that it has answered, -1 if none.
        pushes: Its announced pushes, by sample.
        measurements: Sends its samples.
        stop: Tells it that the run is over.
    """

    def __init__(self, name: str, session: zenoh.Session, inbox: Inbox, keys: Keys, lag: int) -> None:
        self.is_ready = False
        self.answered = -1
        self.pushes: dict[int, CartPush] = {}
        self._name = name
        self._lag = lag
        self.measurements = Sender(session, keys.robot(name, "measurements"), may_drop=False)
        self.stop = Sender(session, keys.robot(name, "stop"), may_drop=False)
        inbox.watch_links(session, name)
        inbox.listen(session, name, {keys.robot(name, "ready"): Ready, keys.robot(name, "reference"): CartPush})

    def take(self, message: Message) -> None:
        """Process the pusher's message."""
        match message:
            case Ready():
                check_field("robot", message.robot, self._name)
                self.is_ready = self.measurements.has_listener
            case CartPush():
                check_field("robot", message.robot, self._name)
                check_field("answers", message.answers, self.answered + 1)
                check_field("block", message.block, message.answers + self._lag)
                check_numbers(message.wrench, (3,), "wrench")
                check_numbers(message.hand, (2,), "hand")
                self.answered = message.answers
                self.pushes[message.block] = message


class CartServer:
    """The simulation and its links: one session per pusher, one for observers, one inbox for all of them."""

    def __init__(self, config: CartServerConfig, robots: dict[str, zenoh.Session], observers: zenoh.Session) -> None:
        keys = Keys(config.run)
        self._scenario = config.scenario
        self._simulation = CartSimulation(config.scenario)
        self._inbox = Inbox()
        self._truth = Sender(observers, keys.observe_server("truth"), may_drop=True)
        self._problems = ProblemLog(SERVER, Sender(observers, keys.observe_server("problem"), may_drop=True))
        self._links = {
            name: _PusherLink(name, session, self._inbox, keys, config.scenario.lag) for name, session in robots.items()
        }
        self._is_over = False

    def run(self) -> None:
        """Wait for all pushers, simulate until the end, then stop the pushers.

        Raises:
            LinkError: A pusher is lost, or does not answer.
            SimulationError: The cart has moved out of bounds.
        """
        reason = "the run is over"
        try:
            while not all(link.is_ready for link in self._links.values()):
                self._handle(self._inbox.receive())
            for block in range(self._scenario.blocks):
                self._wait_for(block - self._scenario.lag)
                self._advance(block)
            self._wait_for(self._scenario.blocks - 1)
        except CoheftError as error:
            reason = str(error)
            self._problems.tell_end(reason)
            raise
        finally:
            self._is_over = True
            for link in self._links.values():
                link.stop.send(Stop(reason=reason))

    def _advance(self, block: int) -> None:
        pushes = {name: link.pushes.pop(block) for name, link in self._links.items() if block in link.pushes}
        sample = self._simulation.advance(pushes)
        for name, link in self._links.items():
            link.measurements.send(sample.measurements[name])
        self._truth.send(sample.truth)

    def _wait_for(self, block: int) -> None:
        deadline = time.monotonic() + _ANSWER_LIMIT
        while silent := [name for name, link in self._links.items() if link.answered < block]:
            left = deadline - time.monotonic()
            if left <= 0.0:
                raise LinkError(f"{', '.join(silent)} did not answer sample {block} within {_ANSWER_LIMIT:g} s")
            self._handle(self._inbox.receive(left))

    def _handle(self, event: Event | None) -> None:
        match event:
            case Received(name, CartPush() | Ready() as message):
                try:
                    self._links[name].take(message)
                except MessageError as error:
                    self._problems.tell(f"refused from {name}: {error}")
            case Refused(source, error):
                self._problems.tell(f"refused from {source}: {error}")
            case Presence(name, is_here=False) if self._simulation.block > 0 and not self._is_over:
                raise LinkError(f"lost the link with {name}, which had answered sample {self._links[name].answered}")


def run_server(config: CartServerConfig) -> None:
    """Run the server to the end of the run; errors as of ``open_session`` and ``CartServer.run``."""
    with ExitStack() as stack:
        # Observers can connect before the pushers, so that they miss nothing.
        observers = stack.enter_context(open_session(listen=[config.observe]))
        robots = {
            name: stack.enter_context(open_session(listen=[endpoint])) for name, endpoint in config.robots.items()
        }
        CartServer(config, robots, observers).run()


def main() -> NoReturn:
    """Run the server whose configuration is read from stdin."""
    supervised_main(CartServerConfig, run_server)


if __name__ == "__main__":
    main()
