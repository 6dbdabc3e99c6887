"""Whatever neighbours or sensors say, an agent goes on; what it refuses changes nothing."""

from __future__ import annotations

import copy
from functools import cached_property

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coheft.agents.agent import Agent, Outbox
from coheft.app.run.inprocess import TeamInProcess, measured
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.measurement import MeasurementBlock
from coheft.estimation.moments.unknowns import LOAD_SIZE
from coheft.wire.messages.codec import encode
from coheft.wire.messages.structs import NeighbourMessage
from coheft.wire.scenario.file import load_scenario
from tests.fuzz.any_message import KEY, altered, values
from tests.test_uncomputable import with_handover

BLOCKS, MANY_BLOCKS = 3, 60
some = settings(max_examples=settings.default.max_examples // 3)
few = settings(max_examples=settings.default.max_examples // 6)


class Moment:
    """One agent in the middle of a run, and what comes next.

    Args:
        agent: To be copied.
        first: The next block.

    Attributes:
        first: The next block.
        samples: The robot's own of the next blocks.
        heard: What the neighbours send before each of these.
    """

    def __init__(self, agent: Agent, first: int) -> None:
        self.first = first
        self.samples: list[Array] = []
        self.heard: list[list[NeighbourMessage]] = []
        self.agent = agent

    @cached_property
    def undisturbed(self) -> list[bytes]:
        """What the agent says if nothing goes wrong."""
        return said(self.go_on(self.samples, self.heard))

    def go_on(self, samples: list[Array], heard: list[list[NeighbourMessage]]) -> list[Outbox]:
        """What a copy of the agent says in the next blocks."""
        agent = copy.deepcopy(self.agent)
        return [
            agent.step(self.first + k, MeasurementBlock(self.first + k, rows), messages)
            for k, (rows, messages) in enumerate(zip(samples, heard, strict=True))
        ]


@pytest.fixture(
    scope="module",
    params=[("efficient", 1.0), ("efficient", 4.0), ("fan2017", 5.0)],
    ids=lambda param: f"{param[0]} at {param[1]:g} s",
)
def moment(request: pytest.FixtureRequest) -> Moment:
    """The first of three robots, while it finds poses, or sums up."""
    return moment_of(*request.param, blocks=BLOCKS)


def moment_of(estimator: str, time: float, blocks: int) -> Moment:
    """The first of three robots after this time [s], and so many blocks more."""
    scenario = msgspec.structs.replace(load_scenario("ring3"), estimator=estimator)
    team = TeamInProcess(scenario)
    first, name = round(time / scenario.block_duration), scenario.robot_names[0]
    for block in range(first + blocks):
        if block == first:
            moment = Moment(copy.deepcopy(team.agents[name]), first)
        result, heard = team.measure(), team.received()
        if block >= first:
            moment.samples.append(result.measurements[name].samples)
            moment.heard.append(heard[name])
        team.answer(measured(result), heard)
    return moment


def said(outboxes: list[Outbox]) -> list[bytes]:
    """All that others hear, but for the number of messages that were refused."""
    parts = [part for box in outboxes for part in (box.message, box.reference, box.estimate) if part is not None]
    return [
        encode(msgspec.structs.replace(part, problems=0) if hasattr(part, "problems") else part, KEY) for part in parts
    ]


def assert_finite(outboxes: list[Outbox]) -> None:
    for outbox in outboxes:
        arrays = [outbox.reference.motion, outbox.reference.wrench, *outbox.message.channels.values()]
        if (estimate := outbox.estimate) is not None:
            arrays.append(estimate.total_wrench)
            arrays += [number for pose in estimate.poses.values() for number in (pose.rotation, pose.translation)]
            arrays += [pose.covariance for pose in estimate.poses.values()]
            if (payload := estimate.payload) is not None:
                arrays += [each for each in (payload.com, payload.tensor, payload.covariance) if each is not None]
        assert all(np.isfinite(array).all() for array in arrays)


@some
@given(data=st.data())
def test_what_is_refused_changes_nothing(moment: Moment, data: st.DataObject) -> None:
    """Nor does what comes twice, or again."""
    heard: list[list[NeighbourMessage]] = []
    sound: list[NeighbourMessage] = []
    strange = 0
    for messages in moment.heard:
        sound += messages
        again = data.draw(st.lists(st.sampled_from(sound), max_size=3)) if sound else []
        more = data.draw(st.lists(values(NeighbourMessage), max_size=2))
        heard.append(data.draw(st.permutations([*messages, *more, *again])))
        strange += len(more)
    found = moment.go_on(moment.samples, heard)
    assert sum(len(outbox.problems) for outbox in found) == strange
    assert said(found) == moment.undisturbed


@some
@given(data=st.data())
def test_a_message_with_another_value_in_a_place_does_not_stop_an_agent(moment: Moment, data: st.DataObject) -> None:
    """It may be believed: this is what neighbours say. But it must not end in nonsense."""
    heard = [list(messages) for messages in moment.heard]
    block = data.draw(st.sampled_from([k for k, messages in enumerate(heard) if messages]))
    for _ in range(data.draw(st.integers(1, 2))):
        place = data.draw(st.integers(0, len(heard[block]) - 1))
        heard[block][place] = data.draw(altered(heard[block][place]))
    assert_finite(moment.go_on(moment.samples, heard))


FAULTS = st.tuples(
    st.integers(0, BLOCKS - 1),
    st.integers(0, 9),
    st.integers(0, 14),
    st.sampled_from(["set", "add", "scale"]),
    st.sampled_from([np.nan, np.inf, 0.0, 1e3, -1e9, -1e15, 1e77, 1e300]) | st.floats(),
)
"""Block, sample from which on, column, and what becomes of it from then on."""


@pytest.fixture(
    scope="module", params=[("efficient", 0.1, "known"), ("fan2017", 5.0, "sums"), ("fan2017", 5.0, "parameters")]
)
def long_moment(request: pytest.FixtureRequest) -> tuple[Moment, str]:
    """The first of three robots before many blocks, and the channel in which a neighbour says what is not so."""
    estimator, time, channel = request.param
    return moment_of(estimator, time, MANY_BLOCKS), channel


GYROS_AND_LOAD = slice(15 + 3 * Pose.SIZE, 15 + 3 * Pose.SIZE + 3 + LOAD_SIZE)
"""Their numbers in a handover to three robots without sensor errors; with large ones before them it is refused."""
LIES = st.tuples(
    st.integers(0, MANY_BLOCKS // 3),
    st.integers(1, 10),
    st.floats(0.0, 1.0) | st.none(),
    st.sampled_from([1e3, 1e6, -1e8, 1e10]) | st.floats(-1e11, 1e11),
)
"""Block from which on, number of blocks, where in the array (None if everywhere), and about which numbers."""


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # overflows, and what comes of them, are no error in a process
@few
@given(lies=st.lists(LIES, min_size=1, max_size=2))
def test_large_numbers_of_a_neighbour_do_not_stop_an_agent_many_blocks_later(
    long_moment: tuple[Moment, str], lies: list[tuple[int, int, float | None, float]]
) -> None:
    moment, channel = long_moment
    heard = [list(messages) for messages in moment.heard]
    for start, count, place, size in lies:
        for messages in heard[start : start + count]:
            channels = dict(messages[0].channels)
            if channel == "known":
                channels = with_handover(moment.agent, channels)
            if channel not in channels:
                continue
            numbers = channels[channel].copy()
            stated = numbers.reshape(-1)[GYROS_AND_LOAD if channel == "known" else slice(None)]
            if place is None:
                stated[:] = size * np.random.default_rng(1).standard_normal(stated.size)
            else:
                stated[int(place * (stated.size - 1))] = size
            messages[0] = msgspec.structs.replace(messages[0], channels={**channels, channel: numbers})
    assert_finite(moment.go_on(moment.samples, heard))


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # overflows, and what comes of them, are no error in a process
@some
@given(faults=st.lists(FAULTS, min_size=1, max_size=4))
def test_broken_sensors_do_not_stop_an_agent(moment: Moment, faults: list[tuple[int, int, int, str, float]]) -> None:
    samples = [rows.copy() for rows in moment.samples]
    for block, start, column, what, value in faults:
        column_from_then_on = samples[block][start:, column]
        match what:
            case "set":
                column_from_then_on[:] = value
            case "add":
                column_from_then_on += value
            case "scale":
                column_from_then_on *= value
    assert_finite(moment.go_on(samples, moment.heard))
