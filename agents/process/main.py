"""The process of one agent: the pure core with its network links.

``python -m coheft.agents.process.main`` reads an ``AgentProcessConfig`` from stdin.
"""

import math
import time
from collections import deque
from typing import NoReturn

from msgspec import structs

from coheft.agents.agent import Agent
from coheft.agents.process.heartbeat import PERIOD, Heartbeat
from coheft.agents.process.links import HELLO_PERIOD, SERVER, AgentLinks, open_links
from coheft.agents.process.neighbour_link import NeighbourLink
from coheft.agents.process.record_check import open_record_check
from coheft.errors import LinkError, MessageError
from coheft.estimation.measurement import SAMPLE_SIZE, MeasurementBlock
from coheft.wire.config import AgentProcessConfig
from coheft.wire.messages.codec import check_field
from coheft.wire.messages.requests import DisturbRequest
from coheft.wire.messages.structs import (
    Estimate,
    EstimateBeside,
    Hello,
    Measurements,
    Message,
    NeighbourMessage,
    Ready,
    Validity,
)
from coheft.wire.process.log import LOG
from coheft.wire.process.supervised import COMMENT_AFTER, supervised_main
from coheft.wire.scenario.network import LinkQuality
from coheft.wire.scenario.plugins import usable_in_run
from coheft.wire.transport.inbox import Event, Presence

_BACKLOG = 64
"""Number of measurement blocks that may wait; an agent that falls further behind skips the oldest."""
_ASK_AGAIN = 1.0
"""Time without measurements after which the agent asks again [s]: only the server may have noticed a lost link."""
_MAX_EVENTS = 256
"""Number of events read between two steps, and before the links are checked, at most: a sender may be faster than this
agent."""


class AgentProcess:
    """An agent and its links.

    The agent steps when it has measurements of a block k, and the message of block k - 1 of every neighbour that keeps
    pace. A neighbour does not keep pace if its link is down, or once its message took longer than the agent's patience,
    until one arrives in time again. So no robot can block it, and without faults equal runs take equal steps.

    A link to a neighbour that the agent dials is renewed if it is down, or if it is up but does not work in both
    directions.

    The agent asks for measurements when it starts, and again whenever it has lost the server. If the server has
    restarted, with a new world, the agent restarts with an empty memory. It also restarts when measurements name
    another estimator, as all robots do at the same block.
    """

    def __init__(self, config: AgentProcessConfig, links: AgentLinks) -> None:
        self._config = config
        self._network = links
        self._next_check = now = time.monotonic()
        self._read_since = 0  # number of events since the check became due
        self._links = {name: NeighbourLink(name, now) for name in config.agent.neighbours}
        self._records = open_record_check(config.agent.name, config.run, config.security)
        self._measurements: deque[tuple[float, Measurements]] = deque(maxlen=_BACKLOG)
        self._world: int | None = None
        self._attempt = time.time_ns()
        self._is_receiving = False
        self._server_lost_at: float | None = None
        self._comment_at = now + COMMENT_AFTER
        self._last_hello = -math.inf
        self._block = -1
        self._qualities: dict[str, LinkQuality] = {}  # links that the operator has disturbed
        self._start_agent(config.agent.estimator)

    def _start_agent(self, estimator: str) -> None:
        """Replace the agent by a new one with an empty memory."""
        self._incarnation = time.time_ns()
        self._estimator = estimator
        config = structs.replace(self._config.agent, estimator=estimator)
        self._agent = Agent(config, self._incarnation, self._config.largest_arrays, self._records.signatures)
        for neighbour, quality in self._qualities.items():
            self._agent.set_link(neighbour, quality)
        self._is_holding = True
        self._last_estimate: Estimate | None = None

    def run(self) -> None:
        """Process block after block.

        Raises:
            LinkError: The link with the server is lost and not restored in time.
            Stopped: The server has ended the run.
        """
        with Heartbeat(self._say_hello):
            while True:
                self._wait_for_measurements()
                self._wait_for_neighbours()
                if self._measurements:
                    self._step(self._measurements.popleft()[1])

    def _wait_for_measurements(self) -> None:
        """Process received events and wait for measurements; ask for them while none arrive."""
        for _ in range(_MAX_EVENTS):
            if not self._receive(0.0):
                break
        asked = time.monotonic() if self._is_receiving else -math.inf
        while not self._measurements:
            wait = asked + (_ASK_AGAIN if self._is_receiving else HELLO_PERIOD) - time.monotonic()
            if wait > 0.0:
                self._receive(min(wait, PERIOD))
            else:
                self._ask_for_measurements()
                asked = time.monotonic()

    def _ask_for_measurements(self) -> None:
        """Say hello, so that neighbours know that this agent receives their messages, and ask the server for
        measurements.
        """
        if self._server_lost_at is not None and time.monotonic() - self._server_lost_at > self._config.server_limit:
            raise LinkError(
                f"{self._name} lost its link with {SERVER} at block {self._block}, and it did not come back "
                f"within {self._config.server_limit:g} s"
            )
        if time.monotonic() > self._comment_at:
            self._comment_at = math.inf
            LOG.info("waiting for %s at %s", SERVER, self._config.server)
        self._say_hello()
        missing = [name for name, link in self._links.items() if not link.hears_us]
        self._network.ready.send(Ready(robot=self._name, missing=missing, attempt=self._attempt))

    def _answer_hello(self) -> None:
        """Say hello to the neighbours, unless this agent has just done so."""
        if time.monotonic() - self._last_hello > HELLO_PERIOD / 2:
            self._say_hello()

    def _say_hello(self) -> None:
        self._last_hello = time.monotonic()
        received = [name for name, link in self._links.items() if link.is_heard]
        self._network.hello.send(Hello(sender=self._name, heard=received, incarnation=self._incarnation))

    def _wait_for_neighbours(self) -> None:
        """Wait until no message is missing for the next step, there is no step to take, or patience ends."""
        while self._measurements:
            arrival, measurements = self._measurements[0]
            missing = [link for link in self._links.values() if link.is_missing(measurements.block)]
            left = arrival + self._config.patience - time.monotonic()
            if not missing:
                return
            if left > 0.0:
                self._receive(left)
                continue
            for link in missing:
                link.keeps_pace = False

    def _step(self, measurements: Measurements) -> None:
        """Step with the messages that have arrived, and send the results."""
        self._report_links()
        is_first, self._block = self._block < 0, measurements.block
        if (estimator := self._estimator_for(measurements)) != self._estimator:
            since = self._config.agent.start_of(self._block)
            self._network.problems.tell(f"uses the estimator '{estimator}' from {since:.2f} s on, and starts again")
            self._start_agent(estimator)
            for link in self._links.values():
                link.take_messages(self._block)  # they are for the estimator before
        if measurements.holding != self._is_holding:
            self._is_holding = measurements.holding
            self._agent.set_holding(self._is_holding, self._block)
        messages = [message for link in self._links.values() for message in link.take_messages(self._block)]
        outbox = self._agent.step(self._block, MeasurementBlock(self._block, measurements.samples), messages)
        message = outbox.message
        if message.gossip:
            message = structs.replace(message, gossip=self._records.signed(message.gossip))
        self._network.message.send(message)
        if outbox.estimate is not None:
            said = outbox.estimate.status, tuple(outbox.estimate.reasons)
            if self._last_estimate is None or said != (self._last_estimate.status, tuple(self._last_estimate.reasons)):
                LOG.debug("block %d: %s", self._block, "; ".join([outbox.estimate.status, *outbox.estimate.reasons]))
            self._last_estimate = self._completed(outbox.estimate)
            self._network.estimate.send(self._last_estimate)
        for beside in outbox.beside:
            self._network.estimate.send(EstimateBeside(self._completed(beside.estimate)))
        self._network.reference.send(outbox.reference)
        for problem in outbox.problems:
            self._network.problems.tell(problem)
        if is_first:  # neighbours that are connected start with the same block
            for link in self._links.values():
                link.keeps_pace = link.is_heard

    def _completed(self, estimate: Estimate) -> Estimate:
        """Add what only the process knows: problems so far, and disturbed links."""
        return structs.replace(
            estimate,
            problems=self._network.problems.count,
            disturbed={other: quality for other, quality in self._qualities.items() if not quality.is_ideal},
        )

    def _estimator_for(self, measurements: Measurements) -> str:
        return measurements.estimator or self._config.agent.estimator

    def _receive(self, wait: float) -> bool:
        """Wait up to ``wait`` [s] for an event and process it; check the links in between. Return whether there was
        one.
        """
        if wait > 0.0:
            wait = max(0.0, min(wait, self._next_check - time.monotonic()))
        event = self._network.receive(wait)
        if event is not None:
            self._handle(event)
        if time.monotonic() >= self._next_check:
            self._read_since += 1
            if event is None or self._read_since > _MAX_EVENTS:
                self._check_links()
        return event is not None

    def _handle(self, event: Event) -> None:
        change = self._network.handle(event, self._take)
        if change is None:
            return
        match change:
            case Presence(source, is_here) if source == SERVER:
                self._note_server(is_here)
            case Presence(source, is_here):
                self._links[source].note_presence(is_here)
                if is_here and self._is_receiving:
                    self._answer_hello()
            case DisturbRequest(neighbour=neighbour, quality=quality):
                self._qualities[neighbour] = quality
                self._agent.set_link(neighbour, quality)

    def _check_links(self) -> None:
        """Renew the dialled links that do not work; called when all received events have been processed, or many."""
        now = time.monotonic()
        self._next_check, self._read_since = now + PERIOD, 0
        for name, link in self._links.items():
            link.notice_silence(now)
            if name in self._network.dialled and link.begin_anew(now):
                self._network.redial(name)

    def _take(self, source: str, message: Message) -> None:
        """Process a message, or raise a ``MessageError`` if it is not valid here and now."""
        match message:
            case Measurements():
                if message.attempt == self._attempt:
                    self._take_measurements(message)
            case NeighbourMessage():
                check_field("sender", message.sender, source)
                if message.gossip:
                    tell = self._network.problems.tell
                    gossip = self._records.believed(message.gossip, lambda why: tell(f"refused from {source}: {why}"))
                    message = structs.replace(message, gossip=gossip)
                next_block = self._measurements[0][1].block if self._measurements else self._block + 1
                self._links[source].take_message(message, next_block, time.monotonic())
            case Hello():
                check_field("sender", message.sender, source)
                self._links[source].take_hello(message, self._name, time.monotonic())
                if self._is_receiving and not self._links[source].hears_us:
                    self._answer_hello()

    def _take_measurements(self, message: Measurements) -> None:
        """Keep valid measurements for their step; restart the agent if they are of a new world."""
        check_field("robot", message.robot, self._name)
        check_field("samples.shape", message.samples.shape, (self._config.agent.block, SAMPLE_SIZE))
        estimator = self._estimator_for(message)
        if estimator != self._estimator and estimator not in (usable := usable_in_run(self._config.agent.estimator)):
            raise MessageError(f"estimator is {estimator!r} but expected one of {', '.join(usable)}")
        if message.world != self._world:
            if self._world is not None:
                self._network.problems.tell("the server has restarted, so this agent restarts, too")
                self._block = -1
                self._measurements.clear()
                self._start_agent(self._estimator)
            self._world = message.world
        newest = self._measurements[-1][1].block if self._measurements else self._block
        if message.block <= newest:
            raise MessageError(f"block is {message.block} but expected one after {newest}")
        self._is_receiving = True
        self._measurements.append((time.monotonic(), message))

    def _note_server(self, is_here: bool) -> None:
        """Note whether the link with the server is up; report a loss to observers, and dial again."""
        if is_here:
            self._comment_at = math.inf
            self._server_lost_at = None
        elif self._server_lost_at is None:
            self._server_lost_at = time.monotonic()
            self._attempt = time.time_ns()
            self._is_receiving = False
            self._measurements.clear()
            self._network.redial(SERVER)
            for link in self._links.values():
                link.forget()
            text = f"lost the link with {SERVER} after block {self._block}"
            self._network.problems.tell(text)
            if self._last_estimate is not None and self._last_estimate.status is Validity.VALID:
                self._network.estimate.send(structs.replace(self._last_estimate, status=Validity.STALE, reasons=[text]))

    def _report_links(self) -> None:
        """Report neighbours that have become silent, or are back, to observers.

        Called only between steps, so that neighbours that leave at the end of a run are not reported.
        """
        for link in self._links.values():
            if link.take_change() and self._block >= 0:
                self._network.problems.tell(
                    f"{link.name} is {'back' if link.is_linked else 'silent'}, after block {self._block}"
                )

    @property
    def _name(self) -> str:
        return self._config.agent.name


def run_agent(config: AgentProcessConfig) -> None:
    """Run an agent until the server ends the run.

    Raises:
        LinkError: Another process listens at one of its endpoints, or the link with the server is lost and not
            restored.
    """
    with open_links(config, Measurements, NeighbourMessage, config.security, config.largest_message) as links:
        AgentProcess(config, links).run()


def main() -> NoReturn:
    """Run the agent whose configuration is read from stdin."""
    supervised_main(AgentProcessConfig, run_agent)


if __name__ == "__main__":
    main()
