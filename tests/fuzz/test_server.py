"""Whatever robots and operators say, the server refuses it with a reason, or goes on with it."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coheft.errors import LoadError, MessageError
from coheft.physics_server.simulation import Simulation
from coheft.wire.messages.requests import InjectRequest, RemoveRequest
from coheft.wire.messages.structs import Measurements, Ready, Reference
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.reach import Reach
from coheft.wire.transport.inbox import Inbox
from coheft.wire.transport.robot_link import RobotLink
from coheft.wire.transport.sessions import Keys, open_session
from tests.fuzz.any_message import NUMBERS, altered, values
from tests.ports import free_port

SCENARIO = load_scenario("ring3")
LAG, SAMPLES = SCENARIO.lookahead, SCENARIO.sensors.block
REACH = Reach(SCENARIO.robots)


@pytest.fixture(scope="module")
def link() -> Iterator[RobotLink]:
    with open_session(listen=[f"tcp/127.0.0.1:{free_port()}"]) as session:
        yield RobotLink("r1", session, Inbox(), Keys("fuzz"), world=1, lag=LAG, block=SAMPLES, excess=REACH.excess)


@given(data=st.data())
def test_a_robot_link_refuses_what_does_not_fit(link: RobotLink, data: st.DataObject) -> None:
    block = link.answered + 1
    sound = Reference(robot="r1", block=block + LAG, answers=block, motion=np.zeros((SAMPLES, 12)), wrench=np.zeros(6))
    link.send_measurements(Measurements(robot="r1", block=block, samples=np.zeros((SAMPLES, 15))))
    other = st.sampled_from([sound, Ready(robot="r1")]).flatmap(altered) | values(Ready) | values(Reference)
    for message in data.draw(st.lists(other, max_size=3)):
        with contextlib.suppress(MessageError):
            link.take(message)
    if link.owes_answer:
        link.take(sound)
    assert link.answered == block
    reference = link.take_reference(block + LAG)
    assert reference is None or np.isfinite(reference.motion).all()


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("robot", "r2"),
        ("block", 10**6),
        ("motion", np.zeros((SAMPLES, 6))),
        ("motion", np.zeros((SAMPLES + 1, 12))),
        ("motion", np.zeros(3)),
        ("motion", np.full((SAMPLES, 12), -(2**63))),  # whose size is negative
        ("wrench", np.zeros(3)),
        ("wrench", np.zeros((1, 6))),
    ],
)
def test_a_robot_link_names_what_does_not_fit(link: RobotLink, field: str, value: object) -> None:
    block = link.answered + 1
    link.send_measurements(Measurements(robot="r1", block=block, samples=np.zeros((SAMPLES, 15))))
    sound = Reference(robot="r1", block=block + LAG, answers=block, motion=np.zeros((SAMPLES, 12)), wrench=np.zeros(6))
    with pytest.raises(MessageError, match=rf"^{field}.* is .* but expected"):
        link.take(msgspec.structs.replace(sound, **{field: value}))
    assert link.owes_answer
    link.take(sound)


def test_a_robot_link_takes_an_answer_once(link: RobotLink) -> None:
    block = link.answered + 1
    link.send_measurements(Measurements(robot="r1", block=block, samples=np.zeros((SAMPLES, 15))))
    sound = Reference(robot="r1", block=block + LAG, answers=block, motion=np.zeros((SAMPLES, 12)), wrench=np.zeros(6))
    link.take(sound)
    with pytest.raises(MessageError, match="has already been answered"):
        link.take(sound)


def test_a_robot_link_counts_what_no_arm_can_do_as_an_answer_and_tells_it_once(link: RobotLink) -> None:
    def answer(size: float, where: str) -> int:
        block = link.answered + 1
        link.send_measurements(Measurements(robot="r1", block=block, samples=np.zeros((SAMPLES, 15))))
        motion, wrench = np.zeros((SAMPLES, 12)), np.zeros(6)
        motion[1, 4] = size if where == "position" else 0.0
        motion[2, 10] = size if where == "velocity" else 0.0
        wrench[0] = size if where == "wrench" else 0.0
        link.take(Reference(robot="r1", block=block + LAG, answers=block, motion=motion, wrench=wrench))
        return block

    for where in ("position", "velocity", "wrench"):
        first = link.answered + 1
        what = "wrench" if where == "wrench" else "motion"
        with pytest.raises(MessageError, match=rf"^{what} asks for .*e\+.* but expected at most .* holds still"):
            answer(1e9, where)
        for nonsense in (1e300, np.nan, -np.inf):
            second = answer(nonsense, where)
        assert link.answered == second == first + 3
        assert link.is_refused
        assert not link.is_late(second + LAG)
        sound = answer(0.1, where)
        assert not link.is_refused
        for refused in (first, second):
            assert link.take_reference(refused + LAG) is None
            assert not link.is_late(refused + LAG)
        assert link.take_reference(sound + LAG) is not None
        assert link.is_late(sound + LAG + 1)


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return Simulation(msgspec.structs.replace(load_scenario("ring3"), load_changes=()))


@given(
    requests=st.lists(
        values(InjectRequest)
        | values(RemoveRequest)
        | st.builds(InjectRequest, mass=NUMBERS, position=st.tuples(*3 * [NUMBERS])),
        max_size=6,
    )
)
def test_loads_that_cannot_be_are_refused(
    simulation: Simulation, requests: list[InjectRequest | RemoveRequest]
) -> None:
    for request in requests:
        with contextlib.suppress(LoadError):
            if isinstance(request, InjectRequest):
                simulation.inject(request.mass, request.position, request.size)
            else:
                simulation.remove(request.load)
        assert np.isfinite(simulation.data.qvel).all()
        assert all(np.isfinite([load.mass, *load.position]).all() for load in simulation.loads.states)
    for load in simulation.loads.states:
        simulation.remove(load.id)
    assert simulation.loads.slots_free == 4
