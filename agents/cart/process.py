"""The process of one cart pusher: the pure core with its network links.

``python -m coheft.agents.cart.process`` reads a ``CartAgentProcessConfig`` from stdin.
"""

import time
from collections import deque
from typing import NoReturn

import numpy as np
from msgspec import structs

from coheft.agents.cart.agent import CartAgent
from coheft.agents.cart.sums import CHANNELS
from coheft.agents.inbox import is_possible
from coheft.agents.process.links import HELLO_PERIOD, AgentLinks, open_links
from coheft.agents.process.record_check import RecordCheck
from coheft.errors import LinkError, MessageError
from coheft.wire.cart.config import CartAgentConfig, CartAgentProcessConfig
from coheft.wire.cart.messages import CartMeasurement, CartMessage
from coheft.wire.messages.codec import check_field, check_numbers
from coheft.wire.messages.structs import Hello, Message, Ready
from coheft.wire.process.supervised import supervised_main
from coheft.wire.transport.inbox import Event, Presence

_LARGEST = 1e12
"""Limit of the numbers in sums in progress."""


class CartAgentProcess:
    """A pusher and its network links.

    At sample k the pusher uses its measurement k and its neighbours' messages k - 1.
    """

    def __init__(self, config: CartAgentConfig, links: AgentLinks) -> None:
        self._config = config
        self._links = links
        self._agent = CartAgent(config)
        self._records = RecordCheck(config.name)
        self._block = 0
        self._measurements: deque[CartMeasurement] = deque()
        self._next_measurement = 0
        self._messages: dict[int, dict[str, CartMessage]] = {}
        self._received_from: set[str] = set()
        self._received_by: set[str] = set()

    def run(self) -> None:
        """Connect to the neighbours, then answer each sample.

        Raises:
            LinkError: The link with the server is lost.
            Stopped: The server has ended the run.
        """
        self._connect()
        while True:
            self._answer()

    def _connect(self) -> None:
        """Say hello until all neighbours receive this pusher's messages, then ready, until the first sample arrives."""
        next_hello = time.monotonic()
        while not self._measurements:
            wait = next_hello - time.monotonic()
            if wait > 0.0:
                self._handle(self._links.receive(wait))
                continue
            self._links.hello.send(Hello(sender=self._config.name, heard=sorted(self._received_from)))
            if self._received_by.issuperset(self._config.neighbours):
                self._links.ready.send(Ready(robot=self._config.name))
            next_hello = time.monotonic() + HELLO_PERIOD

    def _answer(self) -> None:
        """Wait for the measurement and the messages of one sample, step, and send the results."""
        expected = set(self._config.neighbours) if self._block > 0 else set()
        while not self._measurements or expected - self._messages.get(self._block - 1, {}).keys():
            self._handle(self._links.receive())
        received = self._messages.pop(self._block - 1, {})
        outbox = self._agent.step(self._measurements.popleft(), list(received.values()))
        self._block += 1
        self._links.message.send(outbox.message)
        self._links.reference.send(outbox.push)
        if outbox.estimate is not None:
            self._links.estimate.send(structs.replace(outbox.estimate, problems=self._links.problems.count))

    def _handle(self, event: Event | None) -> None:
        match self._links.handle(event, self._take):
            case Presence(source, is_here=False):
                raise LinkError(f"{self._config.name} lost its link with {source} at sample {self._block}")

    def _take(self, source: str, message: Message) -> None:
        match message:
            case CartMeasurement():
                check_field("robot", message.robot, self._config.name)
                check_field("block", message.block, self._next_measurement)
                check_numbers(message.motion, (6,), "motion")
                check_numbers(message.wrench, (3,), "wrench")
                check_numbers(message.hand, (2,), "hand")
                self._measurements.append(message)
                self._next_measurement += 1
            case CartMessage():
                self._check_message(source, message)
                tell = self._links.problems.tell
                gossip = self._records.believed(message.gossip, lambda text: tell(f"refused from {source}: {text}"))
                self._messages.setdefault(message.block, {})[source] = structs.replace(message, gossip=gossip)
            case Hello():
                check_field("sender", message.sender, source)
                self._received_from.add(source)
                if self._config.name in message.heard:
                    self._received_by.add(source)

    def _check_message(self, source: str, message: CartMessage) -> None:
        check_field("sender", message.sender, source)
        # A neighbour needs this pusher's message of a sample for the next one, so it is at most one sample ahead.
        expected = [b for b in (self._block - 1, self._block) if b >= 0 and source not in self._messages.get(b, {})]
        if message.block not in expected:
            raise MessageError(f"block is {message.block} but expected one of {expected}")
        check_content(message)


def check_content(message: CartMessage) -> None:
    """Check the sums and records in a neighbour's message; raise ``MessageError`` if they cannot be used."""
    rounds = message.valid.size
    check_numbers(message.valid, (rounds,), "valid")
    check_numbers(message.stages, (rounds, 1, CHANNELS), "stages")
    if not np.abs(message.stages).max(initial=0.0) < _LARGEST:  # also true for NaN
        raise MessageError(f"stages contain numbers that are not finite or not below {_LARGEST:g}")
    impossible = [record.robot for record in message.gossip if not is_possible(record)]
    if impossible:
        raise MessageError(f"its record of {impossible[0]!r} is impossible")


def run_agent(config: CartAgentProcessConfig) -> None:
    """Run a pusher until the server ends the run; errors as of ``open_links`` and of the pusher."""
    with open_links(config, CartMeasurement, CartMessage) as links:
        CartAgentProcess(config.agent, links).run()


def main() -> NoReturn:
    """Run the pusher whose configuration is read from stdin."""
    supervised_main(CartAgentProcessConfig, run_agent)


if __name__ == "__main__":
    main()
