"""One agent's process, with the test as its server and its only neighbour: whatever these do, it answers."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
from msgspec import structs

from coheft.agents.process.neighbour_link import SILENCE
from coheft.app.run.plan import make_plan
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import SAMPLE_SIZE
from coheft.wire.messages.codec import decode
from coheft.wire.messages.structs import Hello, Measurements, NeighbourMessage, Ready, Reference, Stop
from coheft.wire.transport.inbox import Inbox, Received
from coheft.wire.transport.sessions import Keys, Sender, open_session

from .team import AGENT, LIMIT, Team, small_scenario, wait_until

WRONG_SHAPES = {"kinematics": np.zeros(3), "sums": np.zeros(1), "sums_valid": np.ones(1), "load_change": np.zeros(0)}


class Surroundings:
    """The server and the neighbour of one agent."""

    def __init__(self, team: Team, stack: ExitStack, agent: int) -> None:
        names = list(team.plan.agents)
        self.name, self.other = names[agent], names[1 - agent]
        self._team, self._stack = team, stack
        plan, keys = team.plan, team.keys
        dialled = [robot.endpoint for robot in plan.agents[self.other].neighbours if robot.endpoint is not None]
        self.neighbour = stack.enter_context(open_session(listen=[plan.agents[self.other].listen], connect=dialled))
        self._from_agent = Inbox()
        self.begin_server()
        self._from_agent.announce(self.neighbour, keys.agent(self.other, "alive"))
        self._hello = Sender(self.neighbour, keys.agent(self.other, "hello"), may_drop=False)
        self._block = Sender(self.neighbour, keys.agent(self.other, "block"), may_drop=False)
        self._rng = np.random.default_rng(1)
        self.attempt = 0

    def begin_server(self) -> None:
        """Listen as the server, with a link of its own."""
        keys = self._team.keys
        endpoint = self._team.plan.server.robots[self.name]
        self.server = self._stack.enter_context(open_session(listen=[endpoint]))
        ready, reference = (keys.robot(self.name, topic) for topic in ("ready", "reference"))
        self._from_agent.listen(self.server, self.name, {ready: Ready, reference: Reference})
        self._measurements = Sender(self.server, keys.robot(self.name, "measurements"), may_drop=False)
        self._stop = Sender(self.server, keys.robot(self.name, "stop"), may_drop=False)

    def wait_until_asked_anew(self) -> None:
        """Wait until it asks for measurements after its link was lost."""
        before = self.attempt
        while self.attempt == before:
            message = self._next()
            self.attempt = message.attempt if isinstance(message, Ready) else before

    def meet(self) -> None:
        """Wait for the links, say hello, wait until the agent asks for measurements and misses none."""
        wait_until(lambda: self._hello.has_listener and self._measurements.has_listener, "the agent's links")
        self.greet(self.name)
        ready = self._next()
        while not isinstance(ready, Ready) or ready.missing:
            ready = self._next()
        self.attempt = ready.attempt

    def greet(self, *heard: str, sender: str = "") -> None:
        """As its neighbour, or as if that were somebody else: whom it hears."""
        self._hello.send(Hello(sender=sender or self.other, heard=list(heard)))

    def dialled_by(self) -> set[str]:
        """Who has a link with its neighbour now."""
        return {str(peer) for peer in self.neighbour.info.peers_zid()}

    @contextmanager
    def hears_hellos(self) -> Iterator[list[Hello]]:
        """What the agent tells its neighbour of whom it hears."""
        key, found = self._team.keys.agent(self.name, "hello"), list[Hello]()
        with self.neighbour.declare_subscriber(
            key, lambda sample: found.append(decode(sample.payload.to_bytes(), Hello, key))
        ):
            yield found

    def measure(
        self,
        block: int,
        world: int = 0,
        attempt: int | None = None,
        estimator: str = "",
        columns: int = SAMPLE_SIZE,
    ) -> None:
        """Let its sensors measure something."""
        samples = self._rng.normal(size=(self._team.plan.agents[self.name].agent.block, columns))
        attempt = self.attempt if attempt is None else attempt
        self._measurements.send(
            Measurements(
                robot=self.name, block=block, samples=samples, world=world, attempt=attempt, estimator=estimator
            )
        )

    def say(self, block: int, channels: dict[str, Array] | None = None) -> None:
        """As its neighbour."""
        self._block.send(NeighbourMessage(sender=self.other, block=block, gossip=[], channels=channels or {}))

    def refuse(self, what: bytes = b"rubbish") -> None:
        """Say rubbish as its neighbour; when that is refused, all that was said before is there."""
        before = len(self._team.refusals(self.name))
        self.neighbour.put(self._team.keys.agent(self.other, "block"), what)
        wait_until(lambda: len(self._team.refusals(self.name)) > before, "the refusal")

    def answers(self, count: int) -> list[int]:
        """The blocks of measurements that it answers next."""
        found: list[int] = []
        while len(found) < count:
            message = self._next()
            if isinstance(message, Reference):
                found.append(message.answers)
        return found

    def wait_until_asked(self) -> None:
        """Wait until it asks for measurements."""
        while not isinstance(self._next(), Ready):
            pass

    def _next(self) -> Ready | Reference:
        event = self._from_agent.receive(LIMIT)
        assert isinstance(event, Received), self._team.log(self.name)
        assert isinstance(event.message, Ready | Reference)
        return event.message

    def finish(self) -> str:
        """Stop it; what it has said to its log."""
        self._stop.send(Stop(reason="enough"))
        assert self._team.exit_status(self.name) == 0
        return self._team.log(self.name)


@contextmanager
def lone_agent(folder: Path, patience: float = LIMIT, agent: int = 0) -> Iterator[Surroundings]:
    """An agent that has met its surroundings: the first of the two waits to be dialled, the other one dials."""
    plan = make_plan(small_scenario(2, "line"))
    with ExitStack() as stack:
        team = Team(plan, Keys(plan.server.run), folder, None, {})
        surroundings = Surroundings(team, stack, agent)
        config = structs.replace(plan.agents[surroundings.name], patience=patience)
        team.start(surroundings.name, AGENT, config)
        stack.callback(team.end, surroundings.name)
        surroundings.meet()
        yield surroundings


def test_an_agent_says_once_where_it_waits_for_its_server_and_goes_on_waiting(tmp_path):
    plan = make_plan(small_scenario(2, "line"))
    with ExitStack() as stack:
        team = Team(plan, Keys(plan.server.run), tmp_path, None, {})
        name, config = next(iter(plan.agents.items()))
        team.start(name, AGENT, config)
        stack.callback(team.end, name)
        wait_until(lambda: team.log(name) != "", "the agent to say something")
        around = Surroundings(team, stack, 0)
        around.meet()
        around.measure(0)
        assert around.answers(1) == [0]
        assert around.finish() == f"waiting for the server at {config.server}\n"


def test_channels_that_come_before_their_shape_is_known_do_no_harm(tmp_path):
    with lone_agent(tmp_path) as around:
        around.say(0, WRONG_SHAPES)
        around.refuse()
        around.measure(0)
        around.measure(1)
        assert around.answers(2) == [0, 1]
        around.finish()


def test_a_hello_in_the_name_of_somebody_else_is_refused(tmp_path):
    with lone_agent(tmp_path) as around:
        around.greet(sender="r9")
        around.refuse()
        assert around.finish().startswith(
            f"refused from {around.other}: sender is 'r9' but expected '{around.other}'\n"
        )


def test_an_agent_that_is_not_fed_any_more_asks_again(tmp_path):
    with lone_agent(tmp_path) as around:
        around.measure(0)
        assert around.answers(1) == [0]
        around.wait_until_asked()  # the server may think that it is gone
        around.measure(1)
        assert around.answers(1) == [1]
        around.finish()


def test_an_agent_whose_server_comes_back_asks_it_at_once(tmp_path):
    with lone_agent(tmp_path) as around:
        waits = []
        for block in range(4):
            around.measure(block)
            assert around.answers(1) == [block]
            around.server.close()
            around.begin_server()
            began = time.monotonic()
            around.wait_until_asked_anew()
            waits.append(time.monotonic() - began)
        assert min(waits) < 0.6  # nothing but the machine is in its way
        around.finish()


def test_a_robot_that_is_fed_says_twice_a_second_whom_it_hears(tmp_path):
    with lone_agent(tmp_path, patience=0.01) as around, around.hears_hellos() as hellos:
        began = time.monotonic()
        for block in range(30):
            around.greet(around.name)
            around.measure(block)
            time.sleep(0.1)
        assert around.answers(30) == list(range(30))
        assert 3 <= len(hellos) <= 2.0 * (time.monotonic() - began) + 3
        assert all(around.other in hello.heard for hello in hellos)
        around.finish()


def test_measurements_of_a_wrong_shape_are_refused(tmp_path):
    with lone_agent(tmp_path, patience=0.1) as around:
        around.measure(0, columns=SAMPLE_SIZE - 1)
        around.measure(1)
        assert around.answers(1) == [1]
        assert re.match(r"refused from the server: samples.shape is \(10, 14\) but expected", around.finish())


def test_a_message_that_is_lost_holds_up_one_step_only(tmp_path):
    with lone_agent(tmp_path, patience=0.5) as around:
        for block in range(20):
            around.measure(block)
        assert around.answers(20) == list(range(20))
        around.finish()


def test_messages_may_come_early_late_doubled_and_out_of_order(tmp_path):
    with lone_agent(tmp_path) as around:
        for block in (3, 0, 0, 5, 2, 1, 4, 1, 0, 7, 6, 8):
            around.say(block)
        around.refuse()
        for block in range(10):
            around.measure(block)
        assert around.answers(10) == list(range(10))
        around.finish()


def test_blocks_of_measurements_may_be_missing_but_not_go_back(tmp_path):
    with lone_agent(tmp_path, patience=0.1) as around:
        for block in (5, 6, 9, 8, 12):
            around.measure(block)
        assert around.answers(4) == [5, 6, 9, 12]
        assert "block is 8 but expected one after 9" in around.finish()


def test_measurements_for_a_former_life_are_not_answered(tmp_path):
    with lone_agent(tmp_path, patience=0.1) as around:
        around.measure(7, attempt=around.attempt - 1)
        around.measure(3)
        assert around.answers(1) == [3]
        assert around.finish() == ""


def test_a_new_world_is_met_with_a_new_mind(tmp_path):
    with lone_agent(tmp_path, patience=0.1) as around:
        around.measure(40, world=1)
        assert around.answers(1) == [40]
        around.measure(0, world=2)
        assert around.answers(1) == [0]
        assert around.finish() == "the server has restarted, so this agent restarts, too\n"


def test_a_link_that_does_not_carry_to_the_neighbour_is_dialled_anew_and_one_that_does_is_left_alone(tmp_path):
    with lone_agent(tmp_path, patience=0.1, agent=1) as around:
        around.measure(0)
        assert around.answers(1) == [0]
        first = around.dialled_by()
        assert len(first) == 1

        def after(seconds: float, *heard: str) -> set[str]:
            deadline = time.monotonic() + seconds
            while time.monotonic() < deadline and around.dialled_by() <= first:
                around.greet(*heard)
                time.sleep(0.1)
            return around.dialled_by()

        assert after(2.0 * SILENCE, around.name) == first
        wait_until(lambda: after(2.0 * SILENCE).isdisjoint(first), "a new link")
        around.greet(around.name)
        around.measure(1)
        assert around.answers(1) == [1]
        around.finish()


def test_another_estimator_is_used_from_the_block_of_its_measurements_on(tmp_path):
    with lone_agent(tmp_path, patience=0.1) as around:
        for block, estimator in enumerate(["", "efficient", "fan2017", "fan2017", ""]):
            around.measure(block, estimator=estimator)
        assert around.answers(5) == list(range(5))
        around.measure(5, estimator="best")
        around.measure(5, estimator="efficient")
        assert around.answers(1) == [5]
        assert around.finish().splitlines() == [
            "uses the estimator 'fan2017' from 0.04 s on, and starts again",
            "uses the estimator 'efficient' from 0.08 s on, and starts again",
            "refused from the server: estimator is 'best' but expected one of efficient, fan2017",
        ]
