"""The robots that one process drives: exchanges messages between their ROS nodes and their agents."""

import math
import time
from collections.abc import Callable, Hashable, Iterable, Mapping
from functools import partial
from typing import NoReturn

import zenoh

from coheft.app.recording import ros
from coheft.app.ros2.bridge import Bridge
from coheft.app.ros2.contents import Contents
from coheft.app.ros2.graph import reasons, shared
from coheft.app.ros2.names import Topic
from coheft.app.ros2.node import RosNode, typed_topic
from coheft.app.ros2.pace import words_of
from coheft.app.ros2.samples import STREAMS, BlockBuilder, Readings, streams_of
from coheft.app.ros2.stamps import LIMIT, Stamps
from coheft.app.run.news import check_estimate
from coheft.errors import CoheftError, MessageError, one_line
from coheft.estimation.geometry.spatial import quaternion_from_rotation, rotation_exp
from coheft.wire.config import AgentConfig, AgentProcessConfig
from coheft.wire.messages.structs import Estimate, EstimateBeside, Measurements, Message, Problem, Reference
from coheft.wire.transport.inbox import Inbox, Presence, Received, Refused
from coheft.wire.transport.robot_link import RobotLink
from coheft.wire.transport.security import Guard
from coheft.wire.transport.sessions import Keys

_POLL = 0.02
_SILENCE = 4.0
"""Time without progress after which a message is printed [s]."""
_PATIENCE = 5.0
"""Time to wait for robots that send no measurements while others do [s]."""
_LONGEST = 10**6 * 10**9
"""Longest time from the epoch to the first measurements [ns]: agents count samples from there."""
_SLOW, _MANY = 0.8, 20
"""Share of the others' measurements below which a sensor is slow, and the number of measurements for this check."""
_LINES = 20
"""Largest number of different complaints that are printed."""


class Team:
    """Robots whose sensors and arms are in ROS 2."""

    def __init__(self, node: RosNode, inbox: Inbox, tell: Callable[[str], None]) -> None:
        self._node = node
        self._inbox = inbox
        self._print = tell
        self._printed: set[Hashable] = set()
        self._links: dict[str, RobotLink] = {}
        self._configs: dict[str, AgentConfig] = {}
        self._next: dict[str, int] = {}
        self._streams: list[tuple[str, str]] = []  # robot and kind of all that is measured
        self._readings = Readings(self._complain)
        self._epoch = 0
        self._bridge = Bridge(node)
        self._had_router = True
        self._gone: set[str] = set()

    def add(self, config: AgentProcessConfig, session: zenoh.Session, guard: Guard | None) -> None:
        """Add a robot, whose agent dials a session."""
        agent, name = config.agent, config.agent.name
        self._configs[name] = agent
        self._next[name] = 0
        keys, world = Keys(config.run), time.time_ns()
        self._links[name] = RobotLink(name, session, self._inbox, keys, world=world, lag=agent.lag, block=agent.block)
        self._inbox.watch_links(session, name, guard)
        self._inbox.watch_strangers(session, guard)
        for stream in streams_of(agent.sensors_of(name)):
            self._streams.append((name, stream))
            self._node.listen(f"/{name}/{stream}", STREAMS[stream].kind, partial(self._readings.put, name, stream))

    def observe(self, session: zenoh.Session, keys: Keys) -> None:
        """Receive the agents' estimates and problems, on an observer's session."""
        for name in self._links:
            estimate, problem = (keys.observe_agent(name, topic) for topic in ("estimate", "problem"))
            self._inbox.listen(session, name, {estimate: Estimate | EstimateBeside, problem: Problem})

    def wait_until_ready(self) -> None:
        """Wait until every agent asks for measurements and is linked with all its neighbours."""
        next_word = time.monotonic() + _SILENCE
        while waited_for := {name for name, link in self._links.items() if not link.is_settled}:
            self._receive_from_agents(_POLL)
            if time.monotonic() > next_word:
                missing = {other for link in self._links.values() for other in link.missing}
                self._print(f"waiting for the agents of {', '.join(sorted(waited_for | missing))}")
                next_word += _SILENCE

    def begin(self, epoch: int | None) -> Stamps:
        """Wait until robots send measurements and agree on the time; these measurements are not used.

        Block 0 begins at ``epoch``, a ROS time [ns]; None for one block after the measurements.

        Raises:
            CoheftError: The epoch is that of another clock than the robots'.
        """
        self._readings.forget()
        stamps = Stamps(len(self._links))
        if epoch is not None:
            self._set_epoch(epoch)
        topics = ", ".join(self._node.full(f"/{name}/{stream}") for name, stream in self._streams)
        self._print(f"all agents are ready; waiting for measurements on {topics}")
        first_at, next_word = math.inf, time.monotonic() + _SILENCE
        soon = -math.inf if epoch is None else epoch - LIMIT
        while (newest := stamps.settle(patient=time.monotonic() < first_at + _PATIENCE)) is None or newest < soon:
            for robot, _, stamp, _, arrival in self._readings.take(_POLL):
                stamps.receive(robot, stamp, arrival)
                if stamp >= soon:
                    first_at = min(first_at, time.monotonic())
                    agreed = stamps.settle(patient=True)
                    if agreed is not None and agreed >= soon:
                        break  # the fewer are read, the sooner it begins
            self._receive_from_agents(0.0)
            if time.monotonic() > next_word:
                next_word += _SILENCE
                self._report_silence(self._streams)
                if stamps.disagreement:
                    self._print(stamps.disagreement)
                elif newest is not None and epoch is not None:
                    self._print(f"robots measure; by their stamps, block 0 begins in {(epoch - newest) / 1e9:.1f} s")
        if epoch is not None and newest - epoch > _LONGEST:
            raise CoheftError(
                f"--epoch {epoch / 1e9:.3f} is {(newest - epoch) / 1e9:.3g} s before the robots' stamps, the newest "
                f"{newest / 1e9:.3f}, expected at most {_LONGEST / 1e9:g} s: give seconds of the robots' clocks"
            )
        if epoch is None:
            self._set_epoch(newest + max(agent.block * 10**9 // agent.rate for agent in self._configs.values()))
        return stamps

    def go_on(self, stamps: Stamps) -> NoReturn:
        """Exchange messages without end; report agents that receive no measurements for a while."""
        builders = {
            name: BlockBuilder(name, agent.rate, agent.block, self._epoch, stamps, agent.sensors_of(name))
            for name, agent in self._configs.items()
        }
        contents = Contents(
            {name: agent.rate / agent.block for name, agent in self._configs.items()},
            {name: agent.sensors_of(name) for name, agent in self._configs.items()},
        )
        fed_at = dict.fromkeys(builders, time.monotonic())
        refused_at = dict.fromkeys(self._streams, -math.inf)
        next_look = time.monotonic() + _SILENCE
        while True:
            for robot, stream, stamp, values, arrival in self._readings.take(_POLL):
                try:
                    block = builders[robot].add(stream, stamp, values, arrival)
                except MessageError as error:
                    if time.monotonic() > refused_at[robot, stream] + _SILENCE:
                        refused_at[robot, stream] = time.monotonic()
                        self._print(f"refused from /{robot}/{stream}: {error}")
                    continue
                if block is not None:
                    number, samples = block
                    self._next[robot] = number + 1
                    if self._links[robot].is_ready:
                        self._links[robot].send_measurements(Measurements(robot=robot, block=number, samples=samples))
                    contents.note(robot, number, samples)
                    fed_at[robot] = time.monotonic()
            self._receive_from_agents(0.0)
            if time.monotonic() > next_look:
                next_look = time.monotonic() + _SILENCE
                self._report_paces(builders)
                rate = min(agent.rate for agent in self._configs.values())
                if complaint := contents.complaint(rate):
                    self._complain(complaint, "contents")
            unfed = [name for name, moment in fed_at.items() if time.monotonic() > moment + _SILENCE]
            for name in unfed:
                fed_at[name] = time.monotonic()
                self._print(f"{name}: no complete block for {_SILENCE:g} s; {_received_since(builders[name])}")
            streams = [(name, stream) for name, stream in self._streams if name in unfed]
            self._report_silence(streams)
            self._readings.received.difference_update(streams)

    def stop(self, reason: str) -> None:
        """Tell all agents that the run is over."""
        for link in self._links.values():
            link.send_stop(reason)

    def _set_epoch(self, epoch: int) -> None:
        """Set the ROS time of the start of block 0 [ns]."""
        self._epoch = epoch
        self._bridge = Bridge(self._node, epoch)
        self._print(f"block 0 begins at {epoch / 1e9:.3f} s; Ctrl-C ends it")

    def _receive_from_agents(self, seconds: float) -> None:
        """Process an event of the agents, waiting up to a time for it."""
        event = self._inbox.receive(seconds)
        while event is not None:
            match event:
                case Received(name, message):
                    try:
                        self._take(name, message)
                    except MessageError as error:
                        self._complain(f"refused from {name}: {error}")
                case Refused(name, error):
                    self._complain(f"refused from {name}: {error}")
                case Presence(name, is_here):
                    self._note_link(name, is_here)
            event = self._inbox.receive(0.0)

    def _note_link(self, name: str, is_here: bool) -> None:
        """Note whether an agent is linked, and tell when it goes and comes back."""
        link = self._links[name]
        if link.is_linked and not is_here:
            self._gone.add(name)
            self._print(f"the agent of {name} is gone; waiting for it")
        elif is_here and name in self._gone:
            self._gone.remove(name)
            self._print(f"the agent of {name} is back")
        link.note_link(is_here)

    def _take(self, name: str, message: Message) -> None:
        link, config = self._links[name], self._configs[name]
        match message:
            case Estimate():
                check_estimate(message, name, {name, *config.neighbours})
                self._bridge.receive(message)
            case EstimateBeside():
                pass  # ROS 2 has the robot's own
            case Problem():
                self._bridge.receive(Problem(source=name, text=one_line(message.text)))
            case _:
                was_ready = link.is_ready
                link.take(message)
                if link.is_ready and not was_ready:
                    link.join(self._next[name])
                if isinstance(message, Reference) and link.take_reference(message.block) is not None:
                    self._publish(config, message)

    def _publish(self, config: AgentConfig, reference: Reference) -> None:
        name = config.name
        first = reference.block * config.block
        for row, motion in enumerate(reference.motion):
            stamp = self._epoch + (first + row) * 10**9 // config.rate
            turn = quaternion_from_rotation(rotation_exp(motion[:3]))
            self._node.publish(f"/{name}/reference/pose", ros.pose(stamp, f"{name}_home", motion[3:6], turn))
            self._node.publish(f"/{name}/reference/twist", ros.twist(stamp, f"{name}_home", motion[6:]))
        stamp = self._epoch + first * 10**9 // config.rate
        self._node.publish(f"/{name}/reference/wrench", ros.wrench(stamp, name, reference.wrench))

    def _complain(self, text: str, about: Hashable = None) -> None:
        """Print a complaint, unless it, or another one about the same, has been printed."""
        about = about or text
        if about not in self._printed and len(self._printed) < _LINES:
            self._printed.add(about)
            self._print(text)

    def _report_paces(self, builders: Mapping[str, BlockBuilder]) -> None:
        """Report streams whose stamps are wrong, those that several nodes publish, and a router that goes or comes."""
        paces = {name: builder.paces for name, builder in builders.items()}
        for about, words in words_of(paces, {name: self._configs[name].rate for name in builders}).items():
            self._complain(words, about)
        if self._node.has_router != self._had_router:
            self._had_router = not self._had_router
            self._print("the router is back" if self._had_router else "the router of ROS 2 is gone; waiting for it")
        if self._had_router:
            for line in shared(self._topics(self._streams), self._node.seen(), self._node.domain):
                self._complain(line)

    def _topics(self, streams: Iterable[tuple[str, str]]) -> list[Topic]:
        return [typed_topic(self._node.full(f"/{name}/{kind}"), STREAMS[kind].kind) for name, kind in streams]

    def _report_silence(self, streams: Iterable[tuple[str, str]]) -> None:
        """Report streams without measurements, and what is published instead."""
        if silent := [each for each in streams if each not in self._readings.received]:
            own = {topic.name for topic in self._topics(self._streams)}
            for reason in reasons(self._topics(silent), self._node.seen(), self._node.domain, own):
                self._complain(f"nothing has come on {reason}")


def _received_since(builder: BlockBuilder) -> str:
    """Describe what has arrived since the last complete block, and why it may not have completed one."""
    came = ", ".join(f"{count} of {stream}" for stream, count in builder.counts.items())
    text = f"since the last one there came {came}"
    most = max(builder.counts.values())
    slow = [stream for stream, count in builder.counts.items() if 0 < count < _SLOW * most]
    if slow and most > _MANY:
        text += f"; each sample needs one of each, so {', '.join(slow)} must come more often"
    if builder.behind:
        text += f", stamped {builder.behind:.1f} s before the next block at the end: check its clock if that stays so"
    return text
